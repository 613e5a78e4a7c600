/* Made from plant/ by `python -m ballscrew.measurement.identification.laws_in_c`; not for editing.
 *
 * q: parameters in the estimator's order; b: those of the side to which bristles are bent; i: an
 * element; s: sign of the velocity; g: the curve there. States of Dahl and Maxwell slip: forces. */
enum { ELEMENTS = 4, LUGRE_PARAMETERS = 6 };

static inline double lugre_curve(const double *q, double v)
{
    const double Fc = q[3];
    const double Fs = q[4];
    const double ratio = v / q[5];
    return (Fc + (((-Fc) + Fs) * exp((-(ratio * ratio)))));
}

static inline double lugre_bend(const double *q, double v)
{
    const double Fs = q[LUGRE_PARAMETERS];
    const double ratio = v / q[LUGRE_PARAMETERS + 1];
    return (Fs * exp((-(ratio * ratio))));
}

static inline double lugre_curve_at_rest(const double *q)
{
    const double Fs = q[4];
    return Fs;
}

static inline double maxwell_slip_curve(const double *q, double v)
{
    const double Fc = q[10];
    const double Fs = q[11];
    const double ratio = v / q[12];
    return (Fc + (((-Fc) + Fs) * exp((-(ratio * ratio)))));
}

static inline double maxwell_slip_curve_at_rest(const double *q)
{
    const double Fs = q[11];
    return Fs;
}

static inline double classical_curve(const double *q, double v)
{
    const double Fc = q[1];
    const double Fs = q[2];
    const double ratio = v / q[3];
    return (Fc + (((-Fc) + Fs) * exp((-(ratio * ratio)))));
}

static inline double lugre_sign(double v, double Kv)
{
    return (0.6366197723675814 * atan((Kv * v)));
}

static inline double lugre_friction(const double *state, const double *q, const double *b, double s, double v, double g)
{
    const double sigma0 = b[0];
    const double sigma1 = q[1];
    const double sigma2 = q[2];
    const double z = state[0];
    return (((sigma0 * z) + (sigma1 * (((s * s) * v) - ((((s * sigma0) * v) * z) / g)))) + (sigma2 * v));
}

static inline double lugre_rest(const double *q, double s, double g)
{
    const double sigma0 = q[0];
    return ((g * s) / sigma0);
}

static inline double lugre_run(const double *q, double g, double way)
{
    const double sigma0 = q[0];
    return ((sigma0 * way) / g);
}

static inline double lugre_length(const double *q, double g)
{
    const double sigma0 = q[0];
    return (g / sigma0);
}

static inline double dahl_friction(const double *state)
{
    const double force = state[0];
    return force;
}

static inline double dahl_rest(const double *q)
{
    const double Fc = q[1];
    return Fc;
}

static inline double dahl_decay(const double *q)
{
    const double sigma = q[0];
    const double Fc = q[1];
    return (sigma / Fc);
}

static inline double dahl_exponent(const double *q)
{
    const double alpha = q[2];
    return alpha;
}

static inline double bliman_sorine_friction(const double *state)
{
    const double xs1 = state[0];
    const double xs2 = state[1];
    return (xs1 + xs2);
}

static inline double bliman_sorine_fast_rest(const double *q)
{
    const double f1 = q[0];
    return f1;
}

static inline double bliman_sorine_fast_run(const double *q, double way)
{
    const double eps_f = q[2];
    const double eta = q[3];
    return (way / (eps_f * eta));
}

static inline double bliman_sorine_slow_rest(const double *q)
{
    const double f2 = q[1];
    return (-f2);
}

static inline double bliman_sorine_slow_run(const double *q, double way)
{
    const double eps_f = q[2];
    return (way / eps_f);
}

static inline double maxwell_slip_friction(const double *state, const double *q, double v)
{
    const double sigma2 = q[9];
    const double force1 = state[0];
    const double force2 = state[1];
    const double force3 = state[2];
    const double force4 = state[3];
    return ((((force1 + force2) + force3) + force4) + (sigma2 * v));
}

static inline double maxwell_slip_loading(const double *q, int i, double way)
{
    const double k1 = q[i];
    return (k1 * way);
}

static inline double maxwell_slip_rest(const double *q, int i, double g)
{
    const double alpha1 = q[ELEMENTS + i];
    return (alpha1 * g);
}

static inline double maxwell_slip_run(const double *q, double v, double g, double h)
{
    const double C = q[8];
    return (((C * h) * v) / (g * (v + 1e-07)));
}

static inline double classical_friction(const double *q, double s, double v, double g)
{
    const double sigma2 = q[0];
    return ((g * s) + (sigma2 * v));
}

static inline double spring_damping(double stiffness, double mass)
{
    return (0.2 * sqrt((mass * stiffness)));
}
