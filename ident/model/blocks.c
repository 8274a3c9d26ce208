/* Carries out a program of `ident.model.tape` on blocks of samples: all operations on one block, then on the next.
 *
 * numpy takes each operation through thousands of samples, so that intermediate results stream through the outer
 * caches; here they stay in the innermost ones. `ident.model.compiled` calls this where it could be built.
 */
#include <math.h>
#include <stdint.h>
#include <string.h>

/* Grows with every change of what `ident.model.compiled` calls, which does without what was built before it. */
const int32_t interface_version = 3;

/* Samples of a block: few enough for its intermediate results to stay near, and a few of the widest registers. */
enum { BLOCK = 32 };

/* In the order of `compiled.OPERATIONS`. */
enum { NEGATIVE, POSITIVE, SINE, COSINE, TANGENT, ADD, SUBTRACT, MULTIPLY, DIVIDE };

/* What `tape.Program` says; places are counted through inputs, numbers, results and registers. */
typedef struct {
    int64_t inputs, numbers, results, registers, steps;
    const int32_t *code; /* Operation, places of its operands (the same one twice if one), place of its result. */
} program;

/* The widest registers that the processor at hand has, not those that all of its family have. */
#if defined(__x86_64__) && defined(__gnu_linux__) && __GNUC__ >= 12
#define WIDEST __attribute__((target_clones("default", "arch=x86-64-v3", "arch=x86-64-v4")))
#define INLINE static inline __attribute__((always_inline))
#else
#define WIDEST
#define INLINE static inline
#endif

/* sin x = r - r³/3! + r⁵/5! … of what multiples of a quarter turn leave of x, |r| ≤ π/4; terms left out: below 1e-18. */
INLINE double sine_series(double r, double z) {
    return r - r * z * (1.0 / 6 - z * (1.0 / 120 - z * (1.0 / 5040 - z * (1.0 / 362880 - z * (1.0 / 39916800
           - z * (1.0 / 6227020800 - z * (1.0 / 1307674368000 - z / 355687428096000)))))));
}

INLINE double cosine_series(double z) {
    return 1 - z * (0.5 - z * (1.0 / 24 - z * (1.0 / 720 - z * (1.0 / 40320 - z * (1.0 / 3628800
           - z * (1.0 / 479001600 - z * (1.0 / 87178291200 - z / 20922789888000)))))));
}

/* y = sin(x + quarters π/2), to about a unit in the last place; libm's own functions take each number by itself. */
INLINE void sines(const double *x, double *y, int64_t quarters) {
    /* π/2 in three parts; multiples of the first two, of 33 digits, up to 2¹⁹ are exact (Cody and Waite's reduction). */
    const double first = 0x1.921fb544p+0, second = 0x1.0b4611a6p-34, third = 0x1.3198a2e037073p-69;
    const double per_radian = 0x1.45f306dc9c883p-1, rounding = 0x1.8p+52;
    int64_t far = 0;
    for (int s = 0; s < BLOCK; s++) far |= fabs(x[s]) < 0x1p+19 ? 0 : 1;
    if (far) {
        for (int s = 0; s < BLOCK; s++) y[s] = quarters ? cos(x[s]) : sin(x[s]);
        return;
    }
    for (int s = 0; s < BLOCK; s++) {
        /* Where this large number is added, the last digits are an integer. */
        double shifted = x[s] * per_radian + rounding, turns = shifted - rounding;
        double r = x[s] - turns * first - turns * second - turns * third, z = r * r;
        int64_t quadrant;
        memcpy(&quadrant, &shifted, sizeof quadrant);
        quadrant += quarters;
        double sine = sine_series(r, z), cosine = cosine_series(z);
        double value = quadrant & 1 ? cosine : sine;
        y[s] = quadrant & 2 ? -value : value;
    }
}

/* Places hold the results of a block in turn: nothing is read that the same operation has written. */
#define EACH(value) \
    _Pragma("GCC ivdep") \
    for (int s = 0; s < BLOCK; s++) y[s] = value; \
    break

INLINE void run_block(const program *p, double *const *at) {
    const int32_t *step = p->code;
    for (int64_t k = 0; k < p->steps; k++, step += 4) {
        const double *a = at[step[1]], *b = at[step[2]];
        double *y = at[step[3]];
        switch (step[0]) {
        case NEGATIVE: EACH(-a[s]);
        case POSITIVE: EACH(a[s]);
        case SINE: sines(a, y, 0); break;
        case COSINE: sines(a, y, 1); break;
        case TANGENT: EACH(tanh(a[s]));
        case ADD: EACH(a[s] + b[s]);
        case SUBTRACT: EACH(a[s] - b[s]);
        case MULTIPLY: EACH(a[s] * b[s]);
        case DIVIDE: EACH(a[s] / b[s]);
        }
    }
}

/* Tells places where numbers and registers are, and writes the numbers, as often as a block has samples. */
INLINE void furnish(const program *p, const double *numbers, double **at, double *room) {
    double **own = at + p->inputs, **registers = own + p->numbers + p->results;
    for (int64_t k = 0; k < p->numbers; k++, room += BLOCK) {
        own[k] = room;
        for (int s = 0; s < BLOCK; s++) room[s] = numbers[k];
    }
    for (int64_t k = 0; k < p->registers; k++) registers[k] = room + k * BLOCK;
}

/* Writes the results of a block that begins with a sample of the inputs; rows are so many numbers apart. */
INLINE void results_of_block(const program *p, const double *inputs, int64_t input_stride, double *out,
                             int64_t out_stride, double **at) {
    for (int64_t k = 0; k < p->inputs; k++) at[k] = (double *)inputs + k * input_stride;
    for (int64_t k = 0; k < p->results; k++) at[p->inputs + p->numbers + k] = out + k * out_stride;
    run_block(p, at);
}

/* Writes the results of n samples, one block at least; the last two overlap if n is no multiple of a block.
 *
 * at: room for as many pointers as there are places; room: for a block of all numbers and registers.
 */
WIDEST void run(const program *p, const double *numbers, const double *inputs, int64_t input_stride, double *out,
                int64_t out_stride, int64_t n, double **at, double *room) {
    furnish(p, numbers, at, room);
    for (int64_t start = 0; start < n; start += BLOCK) {
        int64_t first = start < n - BLOCK ? start : n - BLOCK;
        results_of_block(p, inputs + first, input_stride, out + first, out_stride, at);
    }
}

/* Eight numbers that are worked on side by side; samples of a group, and how far apart its columns are: not by a power
 * of two, which would have them displace one another from the cache. */
enum { LANES = 8, GROUP = 4 * BLOCK, COLUMN = GROUP + LANES };
typedef double lanes __attribute__((vector_size(LANES * sizeof(double)), aligned(sizeof(double))));

/* Columns (k, GROUP) of a channel in coordinates: each the sum of those up to it, with the weights of a triangle, of
 * which two rows are taken at once; what is below the triangle is zero. */
INLINE void coordinates(const double *columns, int64_t stride, const double *inverse, int64_t first, int64_t k,
                        double *out) {
    for (int64_t j = first; j < k; j += 2)
        for (int64_t s = 0; s < GROUP; s += BLOCK) {
            lanes left[BLOCK / LANES] = {{0}}, right[BLOCK / LANES] = {{0}};
            const int64_t last = j + 1 < k ? j + 1 : j;
            for (int64_t i = first; i <= last; i++) {
                const double of_left = inverse[i * k + j], of_right = inverse[i * k + last];
                for (int v = 0; v < BLOCK / LANES; v++) {
                    const lanes column = *(const lanes *)(columns + i * stride + s + v * LANES);
                    left[v] += of_left * column;
                    right[v] += of_right * column;
                }
            }
            for (int v = 0; v < BLOCK / LANES; v++) {
                *(lanes *)(out + j * COLUMN + s + v * LANES) = left[v];
                if (last > j) *(lanes *)(out + last * COLUMN + s + v * LANES) = right[v];
            }
        }
}

/* Adds the products of some columns a with two columns b to their sums, which are k apart. */
INLINE void add_tile(const double *a, const double *b, int64_t k, const int height, double *sums) {
    lanes sum[4][2] = {{{0}}};
    for (int64_t s = 0; s < GROUP; s += LANES) {
        const lanes b0 = *(const lanes *)(b + s), b1 = *(const lanes *)(b + COLUMN + s);
        for (int r = 0; r < height; r++) {
            const lanes row = *(const lanes *)(a + r * COLUMN + s);
            sum[r][0] += row * b0;
            sum[r][1] += row * b1;
        }
    }
    for (int r = 0; r < height; r++)
        for (int c = 0; c < 2; c++) {
            double total = 0;
            for (int v = 0; v < LANES; v++) total += sum[r][c][v];
            sums[r * k + c] += total;
        }
}

/* Adds the products of all pairs of an even number of columns (k, COLUMN) to their sums, not all of those above the
 * diagonal. */
INLINE void add_products(const double *columns, int64_t first, int64_t k, double *sums) {
    for (int64_t j = first; j < k; j += 4)
        for (int64_t i = first; i < j + 4 && i < k; i += 2) {
            const double *a = columns + j * COLUMN, *b = columns + i * COLUMN;
            if (j + 4 <= k && i <= j) add_tile(a, b, k, 4, sums + j * k + i);
            else if (i <= j) add_tile(a, b, k, 2, sums + j * k + i);
            else if (j + 4 <= k) add_tile(a + 2 * COLUMN, b, k, 2, sums + (j + 2) * k + i);
        }
}

/* Writes what is below the diagonal of a symmetric matrix (k, k) above it. */
INLINE void mirror(double *matrix, int64_t k) {
    for (int64_t j = 0; j < k; j++)
        for (int64_t i = 0; i < j; i++) matrix[i * k + j] = matrix[j * k + i];
}

/* Sums of products of the columns of least squares, in coordinates, over n samples, one block at least.
 *
 * A program computes the first columns of C channels, others are constant, and measurements are the last of k.
 *
 * measured, weights: numbers of each sample and channel (n, C); weights may be missing.
 * inverse: upper triangular (k, k), what columns are multiplied with. first: of each channel, a column before which all
 * are zero, even. rows: columns of a group (k, C, COLUMN), where the constants are. work: zeros for columns of a channel,
 * their number K the next even one (K, COLUMN). sums: of products of pairs of columns (C, K, K).
 */
WIDEST void grams(const program *p, const double *numbers, const double *inputs, int64_t input_stride,
                  const double *measured, const double *weights, int64_t n, int64_t C, int64_t k, const double *inverse,
                  const int64_t *first, double **at, double *room, double *rows, double *work, double *sums) {
    const int64_t even = k + k % 2, pairs = C * even * even;
    memset(sums, 0, pairs * sizeof *sums);
    furnish(p, numbers, at, room);
    for (int64_t group = 0; group < n; group += GROUP) {
        double weight[GROUP] = {0};
        int64_t sample[GROUP] = {0};
        for (int64_t b = 0; b < GROUP && group + b < n; b += BLOCK) {
            /* The last block begins with samples that were there before, and count no more. */
            int64_t begin = group + b < n - BLOCK ? group + b : n - BLOCK;
            results_of_block(p, inputs + begin, input_stride, rows + b, COLUMN, at);
            for (int s = 0; s < BLOCK; s++) {
                sample[b + s] = begin + s;
                weight[b + s] = begin + s < group + b ? 0 : 1;
            }
        }
        for (int64_t c = 0; c < C; c++) {
            double *own = rows + c * COLUMN, *last = own + (k - 1) * C * COLUMN;
            for (int s = 0; s < GROUP; s++) last[s] = measured[sample[s] * C + c];
            coordinates(own, C * COLUMN, inverse, first[c], k, work);
            if (weights || group + GROUP > n)
                for (int64_t j = first[c]; j < k; j++)
                    for (int s = 0; s < GROUP; s++)
                        work[j * COLUMN + s] *= weight[s] * (weights ? weights[sample[s] * C + c] : 1);
            add_products(work, first[c], even, sums + c * even * even);
        }
    }
    for (int64_t c = 0; c < C; c++) mirror(sums + c * even * even, even);
}
