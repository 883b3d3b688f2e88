/* Tables of reflection by brushed (anisotropic) microfacets (shaders/shared/brushed.h), made once a material.
 * Thread-safe. */
#ifndef KILN_WORKER_MATERIAL_BRUSHED_H
#define KILN_WORKER_MATERIAL_BRUSHED_H

#include "shaders/shared/bsdf_lobes.h"

/* Whether a material with these lobes has brushed facets, and so needs a table. */
bool kiln_brushed_wanted(const struct kiln_bsdf_lobes *lobes);
/* Whether two materials with brushed facets can share one table. */
bool kiln_brushed_same(const struct kiln_bsdf_lobes *a, const struct kiln_bsdf_lobes *b);
/* Fills in the table of lobes with brushed facets; takes some hundredths of a second. */
void kiln_brushed_tabulate(struct kiln_brushed_table *table, const struct kiln_bsdf_lobes *lobes);
/* Makes lobes with brushed facets use a table, and computes their means from it. The table must stay in place as long
 * as the lobes are used. */
void kiln_brushed_use(struct kiln_bsdf_lobes *lobes, const struct kiln_brushed_table *table);
/* Returns the table that lobes use; NULL: none. kiln_brushed_move replaces its address, as for a device. */
const struct kiln_brushed_table *kiln_brushed_of(const struct kiln_bsdf_lobes *lobes);
void kiln_brushed_move(struct kiln_bsdf_lobes *lobes, uint64_t address);

/* ---- tables of materials with textures ---- */

/* Grid places, out of 0 to `steps`, that cover roughnesses from `least` to `most`: whole numbers, or one fractional
 * place if both are the same. */
struct kiln_layers {
    float first, last;
    int count;
};
struct kiln_layers kiln_layers_of(float least, float most, int steps);

/* Fills in layers.count tables of a material, one for each roughness. `layers`: of a grid of KILN_BRUSHED_LAYERS - 1
 * steps. */
void kiln_brushed_stack(struct kiln_brushed_table *tables, const struct kiln_bsdf *material, float anisotropy,
                        struct kiln_layers layers);
/* Fills in a material's table of light that its coat holds back, over roughnesses and coats. `layers`, `coats`: of
 * grids of KILN_BSDF_TRAPPED_LAYERS - 1 and KILN_BSDF_TRAPPED_COATS - 1 steps. */
void kiln_bsdf_trapped_tabulate(struct kiln_bsdf_trapped_table *table, const struct kiln_bsdf *material,
                                struct kiln_layers layers, struct kiln_layers coats);

#endif
