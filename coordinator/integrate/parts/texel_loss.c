#include "coordinator/integrate/parts/texel_loss.h"

#include <math.h>
#include <stdbool.h>
#include <stddef.h>

enum {
    SIDE = 8,       /* of a tile, texels */
    HALF = SIDE / 2 /* likewise, texels of twice the size */
};
#define BIN_LEAST 1e-4  /* loss of the first bin; bin 0: none is seen */
#define BIN_STEP 0.0625 /* of the natural logarithm */
#define SHARE 0.95      /* of the texels, that lose less */

/* Means of 2 x 2 texels. */
struct coarse {
    double a[HALF][HALF], b[HALF][HALF];
    bool whole[HALF][HALF];
};

static bool is_whole(uint64_t whole, int u, int v) { return (whole >> (v * SIDE + u) & 1u) != 0; }

static struct coarse make_coarse(const float *a, const float *b, uint64_t whole)
{
    struct coarse c;
    for (int v = 0; v < HALF; v++)
        for (int u = 0; u < HALF; u++) {
            c.a[v][u] = c.b[v][u] = 0.0;
            c.whole[v][u] = true;
            for (int k = 0; k < 4; k++) {
                const int x = 2 * u + k % 2, y = 2 * v + k / 2;
                c.a[v][u] += 0.25 * (double)a[y * SIDE + x];
                c.b[v][u] += 0.25 * (double)b[y * SIDE + x];
                c.whole[v][u] = c.whole[v][u] && is_whole(whole, x, y);
            }
        }
    return c;
}

/* Bilinear interpolation at a texel of the block i, j, whose nearest others are in column x and row y. */
static double between(const double c[HALF][HALF], int i, int j, int x, int y)
{
    return (9.0 * c[j][i] + 3.0 * c[j][x] + 3.0 * c[y][i] + c[y][x]) / 16.0;
}

static size_t bin_of(double loss)
{
    const double at = loss > BIN_LEAST ? 1.0 + log(loss / BIN_LEAST) / BIN_STEP : 0.0;
    return at >= KILN_LOSS_BINS - 1 ? KILN_LOSS_BINS - 1 : (size_t)at;
}

void kiln_texel_losses_add(struct kiln_texel_losses *losses, const float a[KILN_LOSS_TEXELS],
                           const float b[KILN_LOSS_TEXELS], uint64_t whole, double dark)
{
    const struct coarse c = make_coarse(a, b, whole);
    for (int v = 1; v < SIDE - 1; v++)
        for (int u = 1; u < SIDE - 1; u++) {
            const int i = u / 2, j = v / 2, x = u % 2 > 0 ? i + 1 : i - 1, y = v % 2 > 0 ? j + 1 : j - 1;
            if (!c.whole[j][i] || !c.whole[j][x] || !c.whole[y][i] || !c.whole[y][x])
                continue;
            const double light_a = between(c.a, i, j, x, y), light_b = between(c.b, i, j, x, y),
                         allowed = fmax(0.5 * (light_a + light_b), dark),
                         square = ((double)a[v * SIDE + u] - light_a) * ((double)b[v * SIDE + u] - light_b);
            losses->numbers[bin_of(square > 0.0 && allowed > 0.0 ? sqrt(square) / allowed : 0.0)]++;
        }
}

double kiln_texel_losses_most(const struct kiln_texel_losses *losses)
{
    double all = 0.0, below = 0.0;
    size_t b = 0;
    for (size_t i = 0; i < KILN_LOSS_BINS; i++)
        all += (double)losses->numbers[i];
    while (b < KILN_LOSS_BINS - 1 && below + (double)losses->numbers[b] < SHARE * all)
        below += (double)losses->numbers[b++];
    return all > 0.0 && b > 0 ? BIN_LEAST * exp(((double)b - 0.5) * BIN_STEP) : 0.0;
}
