/* Five UAVs that keep a V, evaluated for a whole population: the yardstick by hand.
 *
 * The problem is five_uavs(substeps) of problems.py, and this is what a human reaches
 * who writes for that problem alone: vectors of individuals, the sine and cosine of a
 * heading in one go by polynomials, no library. The machine code that the package makes
 * by itself is measured against it. It is no part of the package.
 *
 *     cc -O3 -march=native -ffp-contract=fast -fno-math-errno -shared -fPIC
 *        -DSUBSTEPS=1 five_uavs.c
 *
 * Speed and heading change evenly over a step, so the four stages of RK4 are known
 * beforehand: a position moves by h/6 (v0 cos t0 + 4 v1 cos t1 + v2 cos t2), Simpson's
 * rule over the start, the middle and the end of a substep.
 */

#ifndef SUBSTEPS
#define SUBSTEPS 1
#endif

#ifdef __AVX512F__
#include <immintrin.h>
#define LANES 8
#else
#define LANES 4
#endif

enum { UAVS = 5, STEPS = 8, ROWS = 2 * UAVS };

typedef double vector __attribute__((vector_size(8 * LANES)));
typedef long long integers __attribute__((vector_size(8 * LANES)));
typedef vector unaligned __attribute__((aligned(8)));

static const double SPEED = 15.0, DISTANCE = 5.0;
static const double SLOT_X[UAVS] = {0, -15, -30, -15, -30};
static const double SLOT_Y[UAVS] = {0, 15, 30, -15, -30};

typedef struct {
    vector speed[UAVS], heading[UAVS], x[UAVS], y[UAVS];
} team;

static inline vector all(double value) { return value - (vector){0}; }

static inline vector load(const double *from) { return *(const unaligned *)from; }

static inline void store(double *to, vector values) { *(unaligned *)to = values; }

static inline vector square(vector a) { return a * a; }

/* Two operations for which compilers find no good AVX-512 code by themselves. */
#ifdef __AVX512F__
static inline vector choose_odd(integers number, vector odd, vector even) {
    __mmask8 is_odd = _mm512_test_epi64_mask((__m512i)number, _mm512_set1_epi64(1));
    return (vector)_mm512_mask_blend_pd(is_odd, (__m512d)even, (__m512d)odd);
}

static inline vector square_root(vector a) {
    return (vector)_mm512_sqrt_pd((__m512d)a);
}
#else
static inline vector choose_odd(integers number, vector odd, vector even) {
    integers is_odd = -(number & 1);
    return (vector)((is_odd & (integers)odd) | (~is_odd & (integers)even));
}

static inline vector square_root(vector a) {
    vector root;
    for (int lane = 0; lane < LANES; lane++) root[lane] = __builtin_sqrt(a[lane]);
    return root;
}
#endif

static inline vector positive_part(vector a) {
    return (vector)((integers)a & (a > 0.0));
}

/* Sine and cosine of |angle| < 2^20: the rest modulo pi/2 by two parts of pi/2, then
 * the polynomials of Cephes on [-pi/4, pi/4], swapped and negated by the quadrant. */
static inline void sine_cosine(vector angle, vector *sine, vector *cosine) {
    const double to_integer = 0x1.8p52; /* Added, the low bits are the quadrant. */
    vector shifted = angle * 0.63661977236758134308 + to_integer;
    vector quadrants = shifted - to_integer;
    vector r = angle - quadrants * 1.5707963267948966;
    r -= quadrants * 6.123233995736765e-17;
    vector z = r * r;

    vector s = z * 1.58962301576546568060e-10 - 2.50507477628578072866e-8;
    s = s * z + 2.75573136213857245213e-6;
    s = s * z - 1.98412698295895385996e-4;
    s = s * z + 8.33333333332211858878e-3;
    s = s * z - 1.66666666666666307295e-1;
    s = r * (s * z + 1.0);

    vector c = z * -1.13585365213876817300e-11 + 2.08757008419747316778e-9;
    c = c * z - 2.75573141792967388112e-7;
    c = c * z + 2.48015872888517045348e-5;
    c = c * z - 1.38888888888730564116e-3;
    c = c * z + 4.16666666666665929218e-2;
    c = c * z - 0.5;
    c = c * z + 1.0;

    integers quadrant = (integers)shifted, sign = (integers){0} + (1LL << 63);
    integers sine_sign = (quadrant << 62) & sign;
    integers cosine_sign = ((quadrant + 1) << 62) & sign;
    *sine = (vector)((integers)choose_odd(quadrant, c, s) ^ sine_sign);
    *cosine = (vector)((integers)choose_odd(quadrant, s, c) ^ cosine_sign);
}

/* Squared errors of one UAV from cruise speed, level heading and its slot. */
static inline vector error(const team *at, int uav, const double *leader) {
    return square(at->speed[uav] - SPEED) + square(at->heading[uav]) +
           square(at->x[uav] - (leader[0] + SLOT_X[uav])) +
           square(at->y[uav] - (leader[1] + SLOT_Y[uav]));
}

/* Move one UAV over a step, its acceleration and turn rate held. */
static inline void move(team *at, int uav, vector acceleration, vector turn_rate) {
    const double h = 1.0 / SUBSTEPS;
    for (int substep = 0; substep < SUBSTEPS; substep++) {
        vector v0 = at->speed[uav], t0 = at->heading[uav];
        vector v1 = v0 + acceleration * (h / 2), t1 = t0 + turn_rate * (h / 2);
        vector v2 = v0 + acceleration * h, t2 = t0 + turn_rate * h;
        vector s0, c0, s1, c1, s2, c2;
        sine_cosine(t0, &s0, &c0);
        sine_cosine(t1, &s1, &c1);
        sine_cosine(t2, &s2, &c2);
        v1 *= 4.0;
        at->x[uav] += (h / 6) * (v0 * c0 + v1 * c1 + v2 * c2);
        at->y[uav] += (h / 6) * (v0 * s0 + v1 * s1 + v2 * s2);
        at->speed[uav] = v2;
        at->heading[uav] = t2;
    }
}

/* What each pair misses of the smallest distance, summed. */
static inline vector closeness(const team *at) {
    vector sum = all(0.0);
#pragma GCC unroll 5
    for (int i = 0; i < UAVS; i++)
#pragma GCC unroll 5
        for (int j = 0; j < i; j++) {
            vector apart = square(at->x[i] - at->x[j]) + square(at->y[i] - at->y[j]);
            sum += positive_part(DISTANCE - square_root(apart));
        }
    return sum;
}

/* Cost and violation of LANES individuals, whose controls begin at `controls`. */
static inline void evaluate(const double *controls, long n, const double *x0,
                            const double *leader, vector *cost, vector *violation) {
    team at;
    for (int i = 0; i < UAVS; i++) {
        at.speed[i] = all(x0[4 * i]);
        at.heading[i] = all(x0[4 * i + 1]);
        at.x[i] = all(x0[4 * i + 2]);
        at.y[i] = all(x0[4 * i + 3]);
    }
    vector spent = all(0.0), broken = all(0.0), end = all(0.0);
    for (int k = 0; k < STEPS; k++) {
        const double *u = controls + (long)ROWS * k * n;
#pragma GCC unroll 5
        for (int i = 0; i < UAVS; i++) {
            vector acceleration = load(u + 2 * i * n);
            vector turn_rate = load(u + (2 * i + 1) * n);
            spent += error(&at, i, leader + 2 * k);
            spent += square(acceleration) + square(turn_rate);
            move(&at, i, acceleration, turn_rate);
        }
        broken += closeness(&at);
    }
    for (int i = 0; i < UAVS; i++) end += error(&at, i, leader + 2 * STEPS);
    *cost = spent + 10.0 * end;
    *violation = broken;
}

/* Cost and violation of n >= 8 individuals.
 *
 * in: controls, (80, n) row by row; initial state (20); unused; the leader's x and y at
 * the nine nodes. out: cost (n), violation (n). The last vector may overlap the one
 * before it, so every n will do.
 */
void kernel(double **in, double **out, long n) {
    for (long start = 0; start < n; start += LANES) {
        long first = start < n - LANES ? start : n - LANES;
        vector cost, violation;
        evaluate(in[0] + first, n, in[1], in[3], &cost, &violation);
        store(out[0] + first, cost);
        store(out[1] + first, violation);
    }
}
