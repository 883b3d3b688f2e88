/* The lobes of all materials of a scene, with the tables that they need (worker/material/brushed.h). */
#ifndef KILN_WORKER_MATERIAL_SCENE_LOBES_H
#define KILN_WORKER_MATERIAL_SCENE_LOBES_H

#include "worker/material/surface_bsdf.h"

/* Creates the lobes of all materials; *lobes is NULL if no material is taken with its gloss. The tables stand behind
 * the lobes in the same allocation. Materials share a table if they can; each table takes some hundredths of a second.
 * The caller frees all with kiln_free. KILN_SYSTEM. */
int kiln_scene_lobes(struct kiln_gloss_lobes **lobes, const struct kiln_scene *scene, struct kiln_error *error);

/* The tables behind the lobes of `count` materials, and their size in bytes: all; tables of brushed facets; tables of
 * light that coats hold back. */
static inline const void *kiln_scene_tables(const struct kiln_gloss_lobes *lobes, size_t count)
{
    return lobes + count;
}
struct kiln_scene_table_bytes {
    size_t all, brushed, trapped;
};
struct kiln_scene_table_bytes kiln_scene_table_bytes(const struct kiln_gloss_lobes *lobes, size_t count);

#endif
