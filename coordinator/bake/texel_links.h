/* The links of one texel of a finished bake that has kept them (integrate/patches/link_file.h): which nodes of the tree
 * it gathers from, to be looked at. The bake is prepared once more, from the scene that it was of. Not collective. */
#ifndef KILN_COORDINATOR_BAKE_TEXEL_LINKS_H
#define KILN_COORDINATOR_BAKE_TEXEL_LINKS_H

#include <stdint.h>

#include "worker/base/status.h"

struct kiln_texel_links {
    /* of each surface point, by global index: the view factor of what the texel is linked to that has this point, %;
     * NaN: it does not see it; -1: it is the texel's own */
    float *share;
    uint64_t points;
    uint32_t nodes, single; /* that it sees: nodes, and points that are linked to by themselves */
    double all;             /* of these, the factors' sum, % */
};

/* `texel`: "OBJECT,X,Y", counted from the upper left of the object's lightmap, of its front. KILN_NO_INPUT: the bake
 * has kept no links; KILN_USAGE: there is no such texel, or it has no light; KILN_BAD_INPUT. Release with
 * kiln_texel_links_release, also after a failure. */
int kiln_texel_links_find(struct kiln_texel_links *links, const char *directory, const char *texel,
                          struct kiln_error *error);
void kiln_texel_links_release(struct kiln_texel_links *links);

#endif
