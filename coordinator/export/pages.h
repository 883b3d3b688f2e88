/* Writes the lightmaps of a finished bake as pages for an exported scene: one page per object, or several objects on a
 * page (an atlas).
 *
 * In an atlas, texels are copied unchanged: nothing is resampled. It keeps the texels that a layout covers and the
 * texels that a bilinear filter reads around them (one on all sides). Islands of such texels (atlas.h), not rectangles,
 * are packed, so at least two texels lie between the covered texels of two islands. A mesh of one object gets
 * coordinates on the page; the link then has scale 1 and offset 0. A mesh that several objects share keeps its layout,
 * which is moved as a whole. The rest of a page is filled from the nearest texels, for filters that reach further.
 * Lightmaps of backs go to separate files with the same layout. Not collective; deterministic. */
#ifndef KILN_COORDINATOR_EXPORT_PAGES_H
#define KILN_COORDINATOR_EXPORT_PAGES_H

#include "coordinator/export/export.h"
#include "coordinator/export/page_format.h"
#include "coordinator/output/read/results.h"
#include "worker/base/arena.h"

struct kiln_pages_params {
    const char *directory;        /* the bake's folder */
    struct kiln_results *results; /* the results in it */
    const char *folder;           /* the folder of the .glb: pages go to its subfolder "lightmaps" */
    const struct kiln_scene *scene;
    const uint8_t *has_back; /* per object: the bake has a lightmap of its backs; NULL: no backs */
    enum kiln_page_format format;
    double range;   /* as for kiln_page_write */
    uint32_t atlas; /* largest side of a page, texels; 0: one page per object */
};

struct kiln_pages {
    struct kiln_link *links; /* one per object */
    struct kiln_page_info *pages;
    size_t page_count;
    struct kiln_vec2 *coordinates; /* per vertex of the scene: TEXCOORD_1 for these pages; NULL: as baked */
    double used;                   /* fraction of the pages' texels that belong to an island; 1 without an atlas */
    char **names;
    size_t name_count;
    struct kiln_arena arena;
};

/* Reads the lightmaps and writes the pages. KILN_BAD_INPUT when an object does not fit a page, or a value does not fit
 * the format. Destroy with kiln_pages_destroy. */
int kiln_pages_write(struct kiln_pages **pages, const struct kiln_pages_params *params, struct kiln_error *error);
void kiln_pages_destroy(struct kiln_pages **pages);

#endif
