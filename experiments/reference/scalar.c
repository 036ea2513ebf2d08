/* Slider-cranks with one clearance joint by hand-written scalar C: the yardstick of `python -m experiments.batches`.

   The equations are those of experiments/reference/problems.py (ADAMS IMPACT, tanh friction), the integrator is Tsit5
   with an elementary error control, started again at nothing: no contact is watched for, so short touches are lost as
   any adaptive solver loses them. `scalar N RTOL SECONDS` solves N clearances, 0.05 to 0.5 mm, over and over for that
   long, and writes N final states (phi, x, phi_dot, x_dot), then the CPU seconds of one round and the attempts in it. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

enum { STATES = 4, STAGES = 7 };

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

static long solve(double clearance, double rtol, double end, double *y) {
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
    if (count != 4) return 2;
    const int lanes = atoi(words[1]);
    const double rtol = atof(words[2]), most = atof(words[3]), pi = acos(-1);
    W = 5000 * 2 * pi / 60;
    STIFFNESS = 4 / (3 * 2 * (1 - 0.3 * 0.3) / 207e9) * sqrt(PIN * 0.0105 / 0.0005);
    double *y = malloc(lanes * sizeof(double[STATES])), best = INFINITY;
    long attempts = 0;
    for (double begin = now(); now() < begin + most;) {
        const double clock = now();
        attempts = 0;
        for (int i = 0; i < lanes; i++)
            attempts += solve(5e-5 + i * 4.5e-4 / (lanes > 1 ? lanes - 1 : 1), rtol, 2 * pi / W, y + STATES * i);
        best = fmin(best, now() - clock);
    }
    for (int i = 0; i < lanes; i++) printf("%.17g %.17g %.17g %.17g\n", y[4 * i], y[4 * i + 1], y[4 * i + 2], y[4 * i + 3]);
    printf("%.9g %ld\n", best, attempts);
    return 0;
}
