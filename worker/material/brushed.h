/* Tables of what brushed facets do (shaders/shared/brushed.h), made for a material once. Thread-safe. */
#ifndef KILN_WORKER_MATERIAL_BRUSHED_H
#define KILN_WORKER_MATERIAL_BRUSHED_H

#include "shaders/shared/bsdf_lobes.h"

/* Whether a material with these lobes has brushed facets, and so needs a table. */
bool kiln_brushed_wanted(const struct kiln_bsdf_lobes *lobes);
/* Whether a table of the one serves the other too; both need one. */
bool kiln_brushed_same(const struct kiln_bsdf_lobes *a, const struct kiln_bsdf_lobes *b);
/* Fills in the table of lobes that need one, in some hundredths of a second. */
void kiln_brushed_tabulate(struct kiln_brushed_table *table, const struct kiln_bsdf_lobes *lobes);
/* Has lobes that need one use the table, which must stay where it is as long as they are used, and finds their means by
 * it. */
void kiln_brushed_use(struct kiln_bsdf_lobes *lobes, const struct kiln_brushed_table *table);
/* The table that lobes use; NULL: none. And another address for it, as on a device. */
const struct kiln_brushed_table *kiln_brushed_of(const struct kiln_bsdf_lobes *lobes);
void kiln_brushed_move(struct kiln_bsdf_lobes *lobes, uint64_t address);

/* ---- tables of materials with textures ---- */

/* Places on a grid of roughnesses, 0 to `steps`, that roughnesses from `least` to `most` need: whole numbers, or the
 * one place that they all have. */
struct kiln_layers {
    float first, last;
    int count;
};
struct kiln_layers kiln_layers_of(float least, float most, int steps);

/* Fills in layers.count tables, of a material with any roughness. `layers`: of KILN_BRUSHED_LAYERS - 1 steps. */
void kiln_brushed_stack(struct kiln_brushed_table *tables, const struct kiln_bsdf *material, float anisotropy,
                        struct kiln_layers layers);
/* Fills in a table, of a material with any roughness and any coat. `layers`, `coats`: of KILN_BSDF_HELD_LAYERS - 1 and
 * KILN_BSDF_HELD_COATS - 1 steps. */
void kiln_bsdf_held_tabulate(struct kiln_bsdf_held_table *table, const struct kiln_bsdf *material,
                             struct kiln_layers layers, struct kiln_layers coats);

#endif
