/* Runs a program of `ident.model.tape` on blocks of samples: all operations on one block, then on the next.
 *
 * numpy applies each operation to thousands of samples, so that intermediate results stream through the outer caches;
 * here they stay in the inner ones. `ident.model.compiled` calls this if it could be built.
 */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* Increased with every change of the interface; `ident.model.compiled` does not use other versions. */
const int32_t interface_version = 6;

/* Samples of a block: few enough for intermediate results to stay in the cache, enough to amortize each operation. */
enum { BLOCK = 64 };

/* Samples of a group, and the stride of its columns: no power of two, with which columns would evict one another from
 * the cache. */
enum { GROUP = 2 * BLOCK, COLUMN = GROUP + 8 };

/* Columns whose products are computed at once, with as many others or fewer. */
enum { TILE = 4 };

/* Operations of a step. Sums, differences, negatives and products are all `± a b ± c`, with ones and zeros for missing
 * operands: a mispredicted branch between several operations costs more than the operation. */
enum { LINEAR, SINE, COSINE, TANGENT, DIVIDE };

typedef struct {
    int32_t operation;
    int32_t a, b, c; /* Places of operands. */
    int32_t result;
    int32_t minus_product, minus; /* 1 if `a b` is subtracted, and `c`. */
} step;

/* As in `compiled.Encoded`; places are numbered through inputs, numbers, results, registers, zero and one. */
typedef struct {
    int64_t inputs, numbers, results, registers, steps;
    const step *code;
} program;

/* Number of places of a program, and of those that are its own blocks. */
static int64_t places(const program *p) { return p->inputs + p->numbers + p->results + p->registers + 2; }
static int64_t blocks(const program *p) { return p->numbers + p->registers + 2; }

/* The first address in some memory that is aligned to a cache line. */
enum { LINE = 64 };
static void *from_line(void *memory) { return (void *)(((uintptr_t)memory + LINE - 1) / LINE * LINE); }

/* The kernels are compiled for registers of several widths; `widest` returns the widest of this processor. Processors
 * with more than 16 registers have room for the sums of a wider tile. */
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
