/* Parser of --texel "OBJECT,X,Y": a texel, counted from the upper left of the lightmap of the object's front. Not
 * collective. */
#ifndef KILN_COORDINATOR_VIEW_TEXEL_PLACE_H
#define KILN_COORDINATOR_VIEW_TEXEL_PLACE_H

#include "worker/scene/scene.h"

struct kiln_texel_place {
    uint32_t object, x, y;
};

/* Parses `texel`. The object's name is the text before the last two commas; the first object of that name is taken.
 * KILN_USAGE if the text has another form or the scene has no such object. */
int kiln_texel_place_read(struct kiln_texel_place *place, const struct kiln_scene *scene, const char *texel,
                          struct kiln_error *error);

/* Returns KILN_USAGE with the message that the texel has no surface. */
int kiln_texel_place_refuse(const char *texel, struct kiln_error *error);

#endif
