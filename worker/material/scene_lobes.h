/* The lobes of all materials of a scene, with the tables that they need (worker/material/brushed.h). */
#ifndef KILN_WORKER_MATERIAL_SCENE_LOBES_H
#define KILN_WORKER_MATERIAL_SCENE_LOBES_H

#include "worker/material/surface_bsdf.h"

/* NULL where no material is taken with its gloss. Tables stand in one piece of memory behind the lobes, one for all
 * materials that it serves; that takes some hundredths of a second for each. The caller frees all with kiln_free.
 * KILN_SYSTEM. */
int kiln_scene_lobes(struct kiln_gloss_lobes **lobes, const struct kiln_scene *scene, struct kiln_error *error);

/* These tables, of `count` materials, and their bytes; some of brushed facets, some of what coats hold back. */
static inline const void *kiln_scene_tables(const struct kiln_gloss_lobes *lobes, size_t count)
{
    return lobes + count;
}
struct kiln_scene_table_bytes {
    size_t all, brushed, held;
};
struct kiln_scene_table_bytes kiln_scene_table_bytes(const struct kiln_gloss_lobes *lobes, size_t count);

#endif
