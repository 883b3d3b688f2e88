#include "worker/backend/embree/run_guide.h"

#include <math.h>
#include <string.h>

void run_guide_begin(struct run_guide *guide, struct tile_run_rays *rays, const struct embree_backend *b,
                     const struct kiln_guided_parameters *parameters, size_t tile_run)
{
    const struct kiln_surface *s = b->surface;
    const struct kiln_tile_run *run = &s->tile_runs[tile_run];
    const uint32_t side = kiln_guide_side(run->count);
    memset(guide->square, 0, sizeof guide->square);
    guide->side = parameters->learns ? side : 0;
    guide->shift = side > 0 ? 32 - (uint32_t)__builtin_ctz(side) : 0;
    if (!parameters->follows || side == 0 || s->guide == NULL)
        return;
    if (kiln_guide_make(guide->guide, s->guide + KILN_GUIDE_FLOATS * kiln_own_of_global(s, run->first).at, side))
        rays->guide = guide->guide;
}

void run_guide_store(const struct run_guide *guide, const struct tile_run_rays *rays,
                     struct kiln_guided_result *results)
{
    const uint32_t cells = guide->side * guide->side;
    const double a_cell = (double)rays->frame.count * rays->samples / cells;
    for (uint32_t k = 0; k < cells; k++)
        results[k / KILN_GUIDE_FLOATS].learnt[k % KILN_GUIDE_FLOATS] = (float)sqrt(guide->square[k] / a_cell);
}
