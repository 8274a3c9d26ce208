/* Kernels that `blocks.c` compiles for registers of BITS, with functions of that TARGET; undefines these macros. */
#define JOINED(name, bits) name##_##bits
#define NAMED(name, bits) JOINED(name, bits)
#define OWN(name) NAMED(name, BITS)
#define INLINE TARGET static inline __attribute__((always_inline))

/* Vectors of numbers, and of their bits, for changing signs. */
#define LANES (BITS / 64)
typedef double OWN(lanes) __attribute__((vector_size(BITS / 8), aligned(8)));
typedef int64_t OWN(signs) __attribute__((vector_size(BITS / 8), aligned(8), may_alias));
#define lanes OWN(lanes)
#define signs OWN(signs)

/* sin r = r - r³/3! + r⁵/5! …, with r = x less multiples of a quarter turn, |r| ≤ π/4; omitted terms are < 1e-18. */
INLINE double OWN(sine_series)(double r, double z) {
    return r - r * z * (1.0 / 6 - z * (1.0 / 120 - z * (1.0 / 5040 - z * (1.0 / 362880 - z * (1.0 / 39916800
           - z * (1.0 / 6227020800 - z * (1.0 / 1307674368000 - z / 355687428096000)))))));
}

INLINE double OWN(cosine_series)(double z) {
    return 1 - z * (0.5 - z * (1.0 / 24 - z * (1.0 / 720 - z * (1.0 / 40320 - z * (1.0 / 3628800
           - z * (1.0 / 479001600 - z * (1.0 / 87178291200 - z / 20922789888000)))))));
}

/* y = sin(x + quarters π/2), to about a unit in the last place; libm's functions are not vectorized. */
INLINE void OWN(sines)(const double *x, double *y, int64_t quarters) {
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
        /* After adding this large number, the last bits are an integer. */
        double shifted = x[s] * per_radian + rounding, turns = shifted - rounding;
        double r = x[s] - turns * first - turns * second - turns * third, z = r * r;
        int64_t quadrant;
        memcpy(&quadrant, &shifted, sizeof quadrant);
        quadrant += quarters;
        double sine = OWN(sine_series)(r, z), cosine = OWN(cosine_series)(z);
        double value = quadrant & 1 ? cosine : sine;
        y[s] = quadrant & 2 ? -value : value;
    }
}

/* y = ± a b ± c */
INLINE void OWN(linear)(const double *a, const double *b, const double *c, int64_t minus_product, int64_t minus,
                        double *y) {
    const signs of_product = (signs){0} + minus_product * INT64_MIN, of_c = (signs){0} + minus * INT64_MIN;
    for (int s = 0; s < BLOCK; s += LANES) {
        const signs first = *(const signs *)(a + s) ^ of_product, last = *(const signs *)(c + s) ^ of_c;
        *(lanes *)(y + s) = (lanes)first * *(const lanes *)(b + s) + (lanes)last;
    }
}

INLINE void OWN(run_block)(const program *p, double *const *at) {
    const step *end = p->code + p->steps;
    for (const step *k = p->code; k < end; k++) {
        const double *a = at[k->a], *b = at[k->b];
        double *y = at[k->result];
        if (k->operation == LINEAR) {
            OWN(linear)(a, b, at[k->c], k->minus_product, k->minus, y);
            continue;
        }
        switch (k->operation) {
        case SINE: OWN(sines)(a, y, 0); break;
        case COSINE: OWN(sines)(a, y, 1); break;
        case TANGENT: for (int s = 0; s < BLOCK; s++) y[s] = tanh(a[s]); break;
        case DIVIDE: for (int s = 0; s < BLOCK; s++) y[s] = a[s] / b[s]; break;
        }
    }
}

INLINE void OWN(fill)(double *block, double number) {
    for (int s = 0; s < BLOCK; s++) block[s] = number;
}

/* Sets the places of numbers, registers, zero and one, and writes the blocks that are constant. */
INLINE void OWN(furnish)(const program *p, const double *numbers, double **at, double *room) {
    double **own = at + p->inputs, **registers = own + p->numbers + p->results;
    for (int64_t k = 0; k < p->numbers; k++, room += BLOCK) OWN(fill)(own[k] = room, numbers[k]);
    for (int64_t k = 0; k < p->registers; k++, room += BLOCK) registers[k] = room;
    for (int k = 0; k < 2; k++, room += BLOCK) OWN(fill)(registers[p->registers + k] = room, k);
}

/* Writes the results of one block; inputs and out point to its first sample, strides are between rows. */
INLINE void OWN(results_of_block)(const program *p, const double *inputs, int64_t input_stride, double *out,
                                  int64_t out_stride, double **at) {
    for (int64_t k = 0; k < p->inputs; k++) at[k] = (double *)inputs + k * input_stride;
    for (int64_t k = 0; k < p->results; k++) at[p->inputs + p->numbers + k] = out + k * out_stride;
    OWN(run_block)(p, at);
}

/* Writes the results of n samples, at least one block; the last two blocks overlap if n is no multiple of BLOCK.
 * Returns 0 if there was no memory, else 1, like `grams`. */
TARGET int32_t OWN(run)(const program *p, const double *numbers, const double *inputs, int64_t input_stride,
                        double *out, int64_t out_stride, int64_t n) {
    void *memory = malloc(LINE + blocks(p) * BLOCK * sizeof(double) + places(p) * sizeof(double *));
    if (!memory) return 0;
    double *room = from_line(memory), **at = (double **)(room + blocks(p) * BLOCK);
    OWN(furnish)(p, numbers, at, room);
    for (int64_t start = 0; start < n; start += BLOCK) {
        int64_t first = start < n - BLOCK ? start : n - BLOCK;
        OWN(results_of_block)(p, inputs + first, input_stride, out + first, out_stride, at);
    }
    free(memory);
    return 1;
}

/* Columns of a channel, from the first to j, times column j of an upper triangular matrix (k, k). */
INLINE void OWN(combine)(const double *columns, int64_t stride, const double *weights, int64_t first, int64_t j,
                         int64_t k, double *out) {
    for (int64_t s = 0; s < GROUP; s += 4 * LANES) {
        lanes sum[4] = {{0}};
        for (int64_t i = first; i <= j; i++)
            for (int v = 0; v < 4; v++)
                sum[v] += weights[i * k + j] * *(const lanes *)(columns + i * stride + s + v * LANES);
        for (int v = 0; v < 4; v++) *(lanes *)(out + s + v * LANES) = sum[v];
    }
}

INLINE double OWN(total)(const lanes *x) {
    double sum[LANES];
    memcpy(sum, x, sizeof sum);
    for (int half = LANES / 2; half; half /= 2)
        for (int v = 0; v < half; v++) sum[v] += sum[v + half];
    return sum[0];
}

/* Adds the inner products of TILE columns a and TILE_WIDTH columns b to their sums, in rows with stride k. */
INLINE void OWN(add_tile)(const double *const *a, const double *const *b, int64_t k, double *sums) {
    lanes sum[TILE][TILE_WIDTH] = {{{0}}};
    for (int64_t s = 0; s < GROUP; s += LANES)
        for (int r = 0; r < TILE; r++)
            for (int c = 0; c < TILE_WIDTH; c++)
                sum[r][c] += *(const lanes *)(a[r] + s) * *(const lanes *)(b[c] + s);
    for (int r = 0; r < TILE; r++)
        for (int c = 0; c < TILE_WIDTH; c++) sums[r * k + c] += OWN(total)(&sum[r][c]);
}

/* Adds the inner products of pairs of columns, a multiple of TILE, to their sums, without most above the diagonal. */
INLINE void OWN(add_products)(const double *const *columns, int64_t first, int64_t k, double *sums) {
    for (int64_t j = first; j < k; j += TILE)
        for (int64_t i = first; i < j + TILE; i += TILE_WIDTH)
            OWN(add_tile)(columns + j, columns + i, k, sums + j * k + i);
}

/* z_n = x_n + decay z_n-1 for TILE columns x, from their last z of the group before; samples of weight zero are left
 * out, without weights all count. */
INLINE void OWN(remember)(const double *const *x, double decay, const double *weight, double *last, double *out) {
    double z[TILE];
    memcpy(z, last, sizeof z);
    for (int s = 0; s < GROUP; s++)
        for (int r = 0; r < TILE; r++) {
            const int counts = !weight || weight[s] != 0;
            z[r] = counts ? x[r][s] + decay * z[r] : z[r];
            out[r * COLUMN + s] = counts ? z[r] : 0;
        }
    memcpy(last, z, sizeof z);
}

/* Copies the lower triangle of a symmetric matrix (k, k) to the upper one. */
INLINE void OWN(mirror)(double *matrix, int64_t k) {
    for (int64_t j = 0; j < k; j++)
        for (int64_t i = 0; i < j; i++) matrix[i * k + j] = matrix[j * k + i];
}

/* Gram matrices of the columns of a least-squares problem, times a triangular matrix, over n samples, at least one
 * block.
 *
 * A program computes the first columns of C channels, others are constant, and measurements are the last of k. They are
 * padded with zeros to K columns, a multiple of TILE.
 *
 * measured, weights: numbers of each sample and channel (n, C); weights may be missing.
 * decay: for each channel, the share of the sample before that is added to each (see remember), if it is not missing;
 * last: then the columns of the sample before the first (C, K), which become those of the last one.
 * inverse: upper triangular (k, k), by which columns are multiplied; changed: the columns that it changes.
 * first: for each channel, a multiple of TILE before which all columns are zero.
 * rows: columns of a group (k, C, COLUMN), with the constant ones written.
 * sums: Gram matrices (C, K, K).
 */
TARGET int32_t OWN(grams)(const program *p, const double *numbers, const double *inputs, int64_t input_stride,
                          const double *measured, const double *weights, const double *decay,
                          double *last, int64_t n, int64_t C, int64_t k,
                          const double *inverse, const int64_t *changed, int64_t changes, const int64_t *first,
                          double *rows, double *sums) {
    const int64_t K = (k + TILE - 1) / TILE * TILE, numbers_of_work = blocks(p) * BLOCK + K * COLUMN;
    void *memory = malloc(LINE + numbers_of_work * sizeof(double) + (places(p) + K) * sizeof(double *));
    if (!memory) return 0;
    /* Blocks of the program, changed or weighted columns of a channel, and pointers. */
    double *room = from_line(memory), *work = room + blocks(p) * BLOCK, **at = (double **)(room + numbers_of_work);
    const double **columns = (const double **)(at + places(p));
    memset(sums, 0, C * K * K * sizeof *sums);
    memset(work, 0, K * COLUMN * sizeof *work);
    OWN(furnish)(p, numbers, at, room);
    for (int64_t j = k; j < K; j++) columns[j] = work + j * COLUMN;
    double *of_measured = rows + (k - 1) * C * COLUMN;
    for (int64_t group = 0; group < n; group += GROUP) {
        double weight[GROUP] = {0};
        int64_t sample[GROUP] = {0};
        for (int64_t b = 0; b < GROUP && group + b < n; b += BLOCK) {
            /* The last block begins with samples of the block before, whose weight is zero. */
            int64_t begin = group + b < n - BLOCK ? group + b : n - BLOCK;
            OWN(results_of_block)(p, inputs + begin, input_stride, rows + b, COLUMN, at);
            for (int s = 0; s < BLOCK; s++) {
                sample[b + s] = begin + s;
                weight[b + s] = begin + s < group + b ? 0 : 1;
                for (int64_t c = 0; c < C; c++) of_measured[c * COLUMN + b + s] = measured[(begin + s) * C + c];
            }
        }
        for (int64_t c = 0; c < C; c++) {
            double *own = rows + c * COLUMN;
            for (int64_t j = first[c]; j < k; j++) columns[j] = own + j * C * COLUMN;
            for (int64_t m = 0; m < changes; m++) {
                if (changed[m] < first[c]) continue;
                double *out = work + changed[m] * COLUMN;
                OWN(combine)(own, C * COLUMN, inverse, first[c], changed[m], k, out);
                columns[changed[m]] = out;
            }
            if (weights || group + GROUP > n)
                for (int64_t j = first[c]; j < k; j++) {
                    double *out = work + j * COLUMN;
                    for (int s = 0; s < GROUP; s++)
                        out[s] = columns[j][s] * weight[s] * (weights ? weights[sample[s] * C + c] : 1);
                    columns[j] = out;
                }
            if (decay)
                for (int64_t j = first[c]; j < K; j += TILE) {
                    OWN(remember)(columns + j, decay[c], group + GROUP > n ? weight : 0, last + c * K + j,
                                  work + j * COLUMN);
                    for (int r = 0; r < TILE; r++) columns[j + r] = work + (j + r) * COLUMN;
                }
            OWN(add_products)(columns, first[c], K, sums + c * K * K);
        }
    }
    for (int64_t c = 0; c < C; c++) OWN(mirror)(sums + c * K * K, K);
    free(memory);
    return 1;
}

#undef lanes
#undef signs
#undef BITS
#undef TARGET
#undef TILE_WIDTH
