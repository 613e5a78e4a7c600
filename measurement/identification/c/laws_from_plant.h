/* Made from plant/ by `python -m ballscrew.measurement.identification.laws_in_c`; not for editing.
 *
 * q: parameters in the estimator's order; b: those of the side to which bristles are bent; i: an
 * element; s: sign of the velocity; g: the curve there. States of elements: their forces. */
enum { BRISTLES, POWER, RELAXING, ELEMENTS, DRY, SOLVED };
enum { COUNT = 4 }; /* of elements */
/* place of Fc, Fs and Vs, the parameters of a form's curve; -1 without one */
static const int FIRST_OF_CURVE[] = {3, -1, -1, 10, 1, -1};
typedef struct { double sigma0, sigma1, sigma2, Fc, Fs, Vs; } Bristles;
typedef struct { double sigma, Fc, alpha; } Power;
typedef struct { double f1, f2, eps_f, eta; } Relaxing;
typedef struct { double k[COUNT], alpha[COUNT], C, sigma2, Fc, Fs, Vs; } Elements;
typedef struct { double sigma2, Fc, Fs, Vs; } Dry;

static inline double stribeck(double Fc, double Fs, double Vs, double v)
{
    return (Fc + (((-Fc) + Fs) * exp((-((v / Vs) * (v / Vs))))));
}
static inline double smooth_sign(double v, double Kv)
{
    return (0.6366197723675814 * atan((Kv * v)));
}
static inline double bristles_force(const Bristles *q, const Bristles *b, double z, double s, double v, double g)
{
    return (((b->sigma0 * z) + (q->sigma1 * (((s * s) * v) - ((((s * b->sigma0) * v) * z) / g)))) + (q->sigma2 * v));
}
static inline double bristles_rest(const Bristles *q, double s, double g)
{
    return ((g * s) / q->sigma0);
}
static inline double bristles_run(const Bristles *q, double g, double way)
{
    return ((q->sigma0 * way) / g);
}
static inline double bristles_length(const Bristles *q, double g) { return (g / q->sigma0); }
static inline double power_rest(const Power *q) { return q->Fc; }
static inline double power_decay(const Power *q) { return (q->sigma / q->Fc); }
static inline double power_exponent(const Power *q) { return q->alpha; }
static inline double relaxing_fast_rest(const Relaxing *q) { return q->f1; }
static inline double relaxing_fast_run(const Relaxing *q, double way)
{
    return (way / (q->eps_f * q->eta));
}
static inline double relaxing_slow_rest(const Relaxing *q) { return (-q->f2); }
static inline double relaxing_slow_run(const Relaxing *q, double way) { return (way / q->eps_f); }
static inline double elements_force(const Elements *q, const double *state, double v)
{
    return ((((state[0] + state[1]) + state[2]) + state[3]) + (q->sigma2 * v));
}
static inline double elements_loading(const Elements *q, int i, double way)
{
    return (q->k[i] * way);
}
static inline double elements_rest(const Elements *q, int i, double g) { return (q->alpha[i] * g); }
static inline double elements_run(const Elements *q, double v, double g, double h)
{
    return (((q->C * h) * v) / (g * (v + 1e-07)));
}
static inline double dry_force(const Dry *q, double s, double v, double g)
{
    return ((g * s) + (q->sigma2 * v));
}
static inline double spring_damping(double stiffness, double mass)
{
    return (0.2 * sqrt((mass * stiffness)));
}
