/* Carries out a program of `ident.model.tape` on blocks of samples: all operations on one block, then on the next.
 *
 * numpy takes each operation through thousands of samples, so that intermediate results stream through the outer
 * caches; here they stay in the inner ones. `ident.model.compiled` calls this where it could be built.
 */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* Grows with every change of what `ident.model.compiled` calls, which does without what was built before it. */
const int32_t interface_version = 5;

/* Samples of a block: few enough for its intermediate results to stay near, and many for the time to find them. */
enum { BLOCK = 64 };

/* Samples of a group, and how far apart its columns are: not by a power of two, which would have them displace one
 * another from the cache. */
enum { GROUP = 2 * BLOCK, COLUMN = GROUP + 8 };

/* Columns that products are taken of at once, with as many others or fewer. */
enum { TILE = 4 };

/* What a step does. Sums, differences, negatives and products are all `± a b ± c`, where ones and zeros stand for what
 * they lack: a processor that cannot foresee which of several operations comes next waits longer than one takes. */
enum { LINEAR, SINE, COSINE, TANGENT, DIVIDE };

typedef struct {
    int32_t operation;
    int32_t a, b, c; /* Places of operands. */
    int32_t result;
    int32_t minus_product, minus; /* Whether `a b` is subtracted, and `c`. */
} step;

/* What `compiled.Encoded` says; places are counted through inputs, numbers, results, registers, zero and one. */
typedef struct {
    int64_t inputs, numbers, results, registers, steps;
    const step *code;
} program;

/* How many places a program has, and how many of them are blocks of its own. */
static int64_t places(const program *p) { return p->inputs + p->numbers + p->results + p->registers + 2; }
static int64_t blocks(const program *p) { return p->numbers + p->registers + 2; }

/* The first of some memory that a line of the cache begins with. */
enum { LINE = 64 };
static void *from_line(void *memory) { return (void *)(((uintptr_t)memory + LINE - 1) / LINE * LINE); }

/* The kernels are compiled for registers of several widths, of which `widest` tells the widest that this processor
 * has; more than 16 of them also hold the sums of a wider tile. */
#if defined(__x86_64__)
#define BITS 512
#define TARGET __attribute__((target("avx512f,avx512dq,avx512vl,fma")))
#define TILE_WIDTH 4
#include "kernels.h"
#define BITS 256
#define TARGET __attribute__((target("avx2,fma")))
#define TILE_WIDTH 2
#include "kernels.h"
#define TILE_WIDTH 2
#else
#define TILE_WIDTH 4
#endif
#define BITS 128
#define TARGET
#include "kernels.h"

int32_t widest(void) {
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl"))
        return 512;
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return 256;
#endif
    return 128;
}
