/* Links of one texel of a finished bake that has kept its links (integrate/patches/link_file.h): the nodes of the tree
 * from which the texel gathers, for inspection. The bake's scene is prepared again for this. Not collective. */
#ifndef KILN_COORDINATOR_BAKE_TEXEL_LINKS_H
#define KILN_COORDINATOR_BAKE_TEXEL_LINKS_H

#include <stdint.h>

#include "worker/base/status.h"

struct kiln_texel_links {
    /* for each surface point, by global index: the view factor of the linked node or point that contains it, %; NaN:
     * the texel does not see it; -1: the point is the texel's own */
    float *share;
    uint64_t points;
    uint32_t nodes, single; /* linked nodes, and points that are linked individually */
    double all;             /* sum of all their view factors, % */
};

/* Finds the links of `texel`, "OBJECT,X,Y", counted from the upper left of the object's lightmap, of its front.
 * KILN_NO_INPUT: the bake has kept no links; KILN_USAGE: there is no such texel, or it has no light; KILN_BAD_INPUT.
 * Release with kiln_texel_links_release, also after a failure. */
int kiln_texel_links_find(struct kiln_texel_links *links, const char *directory, const char *texel,
                          struct kiln_error *error);
void kiln_texel_links_release(struct kiln_texel_links *links);

#endif
