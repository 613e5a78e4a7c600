/* Laws along a motion between whose samples the velocity varies, of a block that is rigid or behind
 * a spring or a gap, see law_along_record.py. */
#define GAP_PARTS 8      /* steps between two samples */
#define SPRING_STEP 0.15 /* step over the spring's time constant */

/* Motion between two samples: the cubic through both positions and velocities. */
typedef struct {
    double x, way, v, change, left, right, step;
} Between;

static Between between(const double *x, const double *v, double step)
{
    const double mean = (x[1] - x[0]) / step;
    return (Between){x[0], x[1] - x[0], v[0], v[1] - v[0], v[0] - mean, v[1] - mean, step};
}

static double place_at(const Between *b, double s)
{
    const double bend = s * (1.0 - s) * b->step * ((1.0 - s) * b->left - s * b->right);
    return b->x + s * b->way + bend;
}

static double pace_at(const Between *b, double s) { return b->v + s * b->change; }

API void mean_friction_along(const Law *law, const double *x, const double *v, int64_t n,
                             double step, int64_t parts, double *friction)
{
    double state[STATES], place = x[0];
    Pace pace = pace_of(law, v[0]);
    const double h = step / parts;
    begin(law, state);
    for (int64_t k = 0; k < n - 1; k++) {
        const Between b = between(x + k, v + k, step);
        double total = 0.5 * friction_at(law, state, pace);
        for (int j = 1; j <= parts; j++) {
            const double s = (double)j / parts, after = place_at(&b, s), then = pace_at(&b, s);
            advance(law, state, after - place, h, &pace, then);
            total += (j < parts ? 1.0 : 0.5) * friction_at(law, state, pace);
            place = after;
        }
        friction[k] = total / parts;
    }
    friction[n - 1] = friction[n - 2];
}

API void force_behind_spring(const Law *law, const double *x, const double *v, int64_t n,
                             double step, double stiffness, double mass, double *force)
{
    double state[STATES], block = x[0];
    begin(law, state);
    Pace speed = pace_of(law, v[0]);
    const double damping = spring_damping(stiffness, mass), rate = sqrt(stiffness / mass);
    const int parts = (int)fmax(4.0, ceil(step * rate / SPRING_STEP));
    const double h = step / parts;
    for (int64_t k = 1; k < n; k++) {
        const Between b = between(x + k - 1, v + k - 1, step);
        double total = 0.0;
        for (int j = 0; j < parts; j++) {
            const double s = (j + 1.0) / parts;
            const double place = place_at(&b, s), pace = pace_at(&b, s);
            const double friction = friction_at(law, state, speed), v0 = speed.v;
            /* implicit in the joint: stable for any stiffness */
            const double pull = stiffness * (place - block - h * v0) + damping * (pace - v0);
            const double heavy = mass + h * damping + h * h * stiffness;
            const double then = v0 + h * ((pull - friction) / heavy);
            advance(law, state, h * then, h, &speed, then);
            block += h * then;
            total += stiffness * (place - block) + damping * (pace - then);
        }
        force[k - 1] = total / parts;
    }
    force[n - 1] = force[n - 2];
}

API void force_behind_gap(const Law *law, const double *x, const double *v, int64_t n, double step,
                          double gap, double mass, double *force)
{
    double state[STATES], block = x[0], side = 0.0;
    begin(law, state);
    Pace speed = pace_of(law, 0.0);
    const double h = step / GAP_PARTS;
    for (int64_t k = 0; k < n - 1; k++) {
        const Between b = between(x + k, v + k, step);
        const double pull = b.change / step;
        double total = 0.0;
        for (int j = 1; j <= GAP_PARTS; j++) {
            const double s = (double)j / GAP_PARTS;
            const double push = place_at(&b, s), pushed = pace_at(&b, s);
            double place = push - side * 0.5 * gap;
            if (side != 0.0) {
                advance(law, state, place - block, h, &speed, pushed);
                block = place;
                double contact = mass * pull + friction_at(law, state, speed);
                if (side * contact < 0.0)
                    contact = side = 0.0;
                total += contact;
                continue;
            }
            double slid = speed.v - h / mass * friction_at(law, state, speed);
            place = block + h * slid;
            const double off = push - place;
            if (fabs(off) > 0.5 * gap) {
                side = off > 0.0 ? 1.0 : -1.0;
                place = push - side * 0.5 * gap;
                total += mass * (pushed - slid) / h;
                slid = pushed;
            }
            advance(law, state, place - block, h, &speed, slid);
            block = place;
        }
        force[k] = total / GAP_PARTS;
    }
    force[n - 1] = force[n - 2];
}

/* Positions that are short by `backlash` [m] after a record's start and after each reversal. */
API void with_backlash(const double *x, const int64_t *starts, int64_t records,
                       const double *backlash, double *dragged)
{
    for (int64_t r = 0; r < records; r++) {
        double at = x[starts[r]];
        for (int64_t k = starts[r]; k < starts[r + 1]; k++) {
            at = fmin(fmax(at, x[k] - backlash[r]), x[k] + backlash[r]);
            dragged[k] = at;
        }
    }
}
