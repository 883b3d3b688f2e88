/* The lightmaps of a finished bake as pages beside an exported scene: one an object, or several objects on a page (an
 * atlas).
 *
 * In an atlas, texels are copied as they are: nothing is resampled. What a layout covers, and the texels that a
 * bilinear filter reads there besides (one all round), are kept; islands of such texels (atlas.h), not rectangles, are
 * packed, so two texels at least are between what two islands cover. A mesh that one object has gets coordinates on the
 * page (its link then has scale 1 and offset 0); one that several share keeps its layout, which is moved as a whole.
 * The rest of a page is filled from the nearest texels, for filters that reach further. Lightmaps of backs go to files
 * of their own, beside, laid out as those of the fronts. Not collective; deterministic. */
#ifndef KILN_COORDINATOR_EXPORT_PAGES_H
#define KILN_COORDINATOR_EXPORT_PAGES_H

#include "coordinator/export/export.h"
#include "coordinator/export/page_format.h"
#include "coordinator/output/read/results.h"

struct kiln_pages_params {
    const char *directory;        /* of the bake */
    struct kiln_results *results; /* the same */
    const char *folder;           /* where the .glb goes: pages are written to its subfolder "lightmaps" */
    const struct kiln_scene *scene;
    const uint8_t *has_back; /* an object: the bake has a lightmap of its backs; NULL: of none */
    enum kiln_page_format format;
    double range;   /* as kiln_page_write takes it */
    uint32_t atlas; /* largest side of a page; 0: one page an object */
};

struct kiln_pages {
    struct kiln_link *links; /* one an object */
    struct kiln_page_info *pages;
    size_t page_count;
    struct kiln_vec2 *coordinates; /* a vertex of the scene: TEXCOORD_1 with these pages; NULL: as baked */
    double used;                   /* share of the pages' texels that some island keeps; 1 without an atlas */
    char **names;
    size_t name_count;
};

/* Reads the lightmaps, writes the pages. KILN_BAD_INPUT when an object does not fit a page, or a value does not fit the
 * format. Destroy with kiln_pages_destroy. */
int kiln_pages_write(struct kiln_pages **pages, const struct kiln_pages_params *params, struct kiln_error *error);
void kiln_pages_destroy(struct kiln_pages **pages);

#endif
