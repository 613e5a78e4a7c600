"""What is done of long work belongs to that work, whatever else is in its folder."""

import json

import pytest

from ballscrew.orchestration.study.workers import KeptParts

pytestmark = pytest.mark.ci


def parts(folder, digest="own"):
    return KeptParts(folder / "work.parts", digest)


@pytest.mark.parametrize(
    "text",
    ["", "[1.0]", '{"found": 1}', '{"of": "own"}', '{"of": "own", "found": [1'],
)
def test_what_no_work_wrote_is_not_taken(tmp_path, text):
    (tmp_path / "work.parts").mkdir()
    (tmp_path / "work.parts" / "a.json").write_text(text)
    assert parts(tmp_path).read("a.json") is None


@pytest.mark.parametrize(
    ("kept", "resume", "refused"),
    [
        ((), False, ""),
        ((), True, "no work to continue"),
        (("own",), False, "add --resume"),
        (("own",), True, ""),
        (("other",), True, "another work"),
        (("other", "own"), True, ""),
        (("half",), False, ""),
        (("unknown",), False, "another work"),
    ],
)
def test_a_folder_is_claimed_by_what_its_parts_belong_to(tmp_path, kept, resume, refused):
    for digest in kept:
        parts(tmp_path, digest).write(f"{digest}.json", 1)
    place = tmp_path / "work.parts"
    if kept == ("half",):
        (place / "half.json").write_text('{"of": "other", "fo')
    if kept == ("unknown",):
        (place / "unknown.json").write_text(json.dumps([1]))
    if not refused:
        parts(tmp_path).claim("work", resume, ValueError)
        return
    with pytest.raises(ValueError, match=refused):
        parts(tmp_path).claim("work", resume, ValueError)
