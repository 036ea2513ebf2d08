/* Slider-cranks with one clearance joint by hand-written scalar C: the yardstick of `python -m experiments.batches`.

   The equations are those of experiments/reference/problems.py (ADAMS IMPACT, tanh friction), the integrator is Tsit5
   with an elementary error control, started again at nothing. `scalar N RTOL SECONDS EVENTS` solves N clearances, 0.05
   to 0.5 mm, over and over for that long, and writes N final states (phi, x, phi_dot, x_dot), then the CPU seconds of
   one round and the attempts in it. A fifth word is a clearance [m] for all of the N. With EVENTS 0 no contact is
   watched for, so short touches are lost as any adaptive solver loses them. With EVENTS 1 steps end where the force law
   changes: touch, the depth of full damping, and the force's zero, found on the cubic through a step's ends at four
   places and by bisection, as the usual event location does; the step is tried again up to a little past it. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

enum { STATES = 4, STAGES = 7, SAMPLES = 4 };

static const double A[STAGES][STAGES - 1] = {
    {0},
    {0.161},
    {-0.008480655492356989, 0.335480655492357},
    {2.8971530571054935, -6.359448489975075, 4.3622954328695815},
    {5.325864828439257, -11.748883564062828, 7.4955393428898365, -0.09249506636175525},
    {5.86145544294642, -12.92096931784711, 8.159367898576159, -0.071584973281401, -0.028269050394068383},
    {0.09646076681806523, 0.01, 0.4798896504144996, 1.379008574103742, -3.290069515436081, 2.324710524099774}};
static const double C[STAGES] = {0, 0.161, 0.327, 0.9, 0.9800255409045097, 1, 1};
static const double E[STAGES] = {-0.00178001105222577714, -0.0008164344596567469, 0.007880878010261995,
                                 -0.1447110071732629,     0.5823571654525552,     -0.45808210592918697,
                                 0.015151515151515152};

static const double PIN = 0.01, DAMPING = 2000, DEPTH = 1e-5, FRICTION = 0.03, TRANSITION = 0.01;
static const double R = 0.05, L = 0.12, ROD = 0.21, ROD_INERTIA = 2.5e-4, SLIDER = 0.14;
static double W, STIFFNESS;

/* The pin in the sleeve at one state: eccentricity, its rate, depth, and the normal force before it is clipped. */
static void contact(double t, const double *y, double clearance, double *e, double *v, double *d, double *raw) {
    const double cw = cos(W * t), sw = sin(W * t), cp = cos(y[0]), sp = sin(y[0]);
    e[0] = y[1] - (R * cw + L * cp), e[1] = -(R * sw + L * sp);
    v[0] = y[3] + R * W * sw + L * y[2] * sp, v[1] = -(R * W * cw + L * y[2] * cp);
    const double length = sqrt(e[0] * e[0] + e[1] * e[1]);
    *d = length - clearance;
    *raw = 0;
    if (*d > 0) {
        const double s = *d < DEPTH ? *d / DEPTH : 1, rate = (e[0] * v[0] + e[1] * v[1]) / length;
        *raw = STIFFNESS * *d * sqrt(*d) + DAMPING * s * s * (3 - 2 * s) * rate;
    }
}

/* Which piece of the force law holds: 0 apart, 1 pulled apart (force clipped), 2 shallow, 3 deep. */
static int piece(double t, const double *y, double clearance) {
    double e[2], v[2], d, raw;
    contact(t, y, clearance, e, v, &d, &raw);
    return d <= 0 ? 0 : raw < 0 ? 1 : d < DEPTH ? 2 : 3;
}

/* The piece at a fraction of a step, on the cubic through its ends. */
static int piece_at(double part, double t, double step, const double *y, const double *next, const double *f,
                    const double *g, double clearance) {
    double here[STATES];
    for (int n = 0; n < STATES; n++) {
        const double jump = next[n] - y[n];
        here[n] = y[n] + part * (jump + (1 - part) * ((1 - part) * (step * f[n] - jump) - part * (step * g[n] - jump)));
    }
    return piece(t + part * step, here, clearance);
}

/* The fraction of a step, just past it, at which another piece of the force law begins; 1 where none does. */
static double first_event(double margin, double t, double step, const double *y, const double *next, const double *f,
                          const double *g, double clearance) {
    const int before = piece(t, y, clearance);
    double from = 0, to = 0;
    for (int i = 1; i <= SAMPLES; i++, from = to) {
        to = i / (double)SAMPLES;
        if ((i == SAMPLES ? piece(t + step, next, clearance) : piece_at(to, t, step, y, next, f, g, clearance)) == before)
            continue;
        while (to - from > 0.5 * margin) {
            const double middle = 0.5 * (from + to);
            if (piece_at(middle, t, step, y, next, f, g, clearance) == before)
                from = middle;
            else
                to = middle;
        }
        return fmin(1, to + 0.5 * margin);
    }
    return 1;
}

static void field(double t, const double *y, double clearance, double *f) {
    const double cw = cos(W * t), sw = sin(W * t), cp = cos(y[0]), sp = sin(y[0]), sleeve = PIN + clearance;
    const double ex = y[1] - (R * cw + L * cp), ey = -(R * sw + L * sp);
    const double vx = y[3] + R * W * sw + L * y[2] * sp, vy = -(R * W * cw + L * y[2] * cp);
    const double length = sqrt(ex * ex + ey * ey), d = length - clearance;
    double fx = 0, torque = ROD * L / 2 * R * W * W * (sw * cp - cw * sp);
    if (d > 0) {
        const double nx = ex / length, ny = ey / length, rate = nx * vx + ny * vy;
        const double slip = nx * vy - ny * vx - sleeve * y[2], s = d < DEPTH ? d / DEPTH : 1;
        const double normal = fmax(0, STIFFNESS * d * sqrt(d) + DAMPING * s * s * (3 - 2 * s) * rate);
        const double traction = -FRICTION * tanh(slip / TRANSITION) * normal;
        const double fy = -normal * ny + traction * nx;
        fx = -normal * nx - traction * ny;
        torque -= (L * cp + sleeve * nx) * fy - (L * sp + sleeve * ny) * fx;
    }
    f[0] = y[2], f[1] = y[3], f[2] = torque / (ROD_INERTIA + ROD * L * L / 4), f[3] = fx / SLIDER;
}

static long solve(double clearance, double rtol, double end, int events, double *y) {
    const double margin = fmin(1e-2, sqrt(rtol));
    const double scale[STATES] = {1, 0.1, W, 0.1 * W};
    double k[STAGES][STATES], next[STATES], t = 0, h = 1e-7;
    long attempts = 0;
    y[0] = 0, y[1] = R + L, y[2] = -W * R / L, y[3] = 0;
    field(t, y, clearance, k[0]);
    while (t < end) {
        const double step = t + h < end ? h : end - t;
        for (int i = 1; i < STAGES; i++) {
            for (int n = 0; n < STATES; n++) {
                double sum = 0;
                for (int j = 0; j < i; j++) sum += A[i][j] * k[j][n];
                next[n] = y[n] + step * sum;
            }
            field(t + C[i] * step, next, clearance, k[i]);
        }
        double error = 0;
        for (int n = 0; n < STATES; n++) {
            double sum = 0;
            for (int j = 0; j < STAGES; j++) sum += E[j] * k[j][n];
            sum *= step / (rtol * (scale[n] + fmax(fabs(y[n]), fabs(next[n]))));
            error += sum * sum / STATES;
        }
        error = sqrt(error);
        attempts++;
        if (events && error <= 1) {
            const double part = first_event(margin, t, step, y, next, k[0], k[STAGES - 1], clearance);
            if (part < 1 - 2 * margin && part * step > 1e-12 * end) {
                h = part * step;
                continue;
            }
        }
        if (error <= 1) {
            t = step < h ? end : t + step;
            for (int n = 0; n < STATES; n++) y[n] = next[n], k[0][n] = k[STAGES - 1][n];
        }
        h = step * fmin(10, fmax(error <= 1 ? 1 : 0.2, 0.9 * pow(fmax(error, 1e-10), -0.2)));
    }
    return attempts;
}

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

int main(int count, char **words) {
    if (count != 5 && count != 6) return 2;
    const double same = count == 6 ? atof(words[5]) : 0;
    const int events = atoi(words[4]);
    const int lanes = atoi(words[1]);
    const double rtol = atof(words[2]), most = atof(words[3]), pi = acos(-1);
    W = 5000 * 2 * pi / 60;
    STIFFNESS = 4 / (3 * 2 * (1 - 0.3 * 0.3) / 207e9) * sqrt(PIN * 0.0105 / 0.0005);
    double *y = malloc(lanes * sizeof(double[STATES])), best = INFINITY;
    long attempts = 0;
    for (double begin = now(); now() < begin + most;) {
        const double clock = now();
        attempts = 0;
        for (int i = 0; i < lanes; i++) {
            const double clearance = same > 0 ? same : 5e-5 + i * 4.5e-4 / (lanes > 1 ? lanes - 1 : 1);
            attempts += solve(clearance, rtol, 2 * pi / W, events, y + STATES * i);
        }
        best = fmin(best, now() - clock);
    }
    for (int i = 0; i < lanes; i++) printf("%.17g %.17g %.17g %.17g\n", y[4 * i], y[4 * i + 1], y[4 * i + 2], y[4 * i + 3]);
    printf("%.9g %ld\n", best, attempts);
    return 0;
}
