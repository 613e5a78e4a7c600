"""A ball that bounces on a rigid floor until it rests."""
