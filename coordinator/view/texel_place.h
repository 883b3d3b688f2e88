/* A texel by name, as --texel gives it: "OBJECT,X,Y", counted from the upper left of the object's lightmap, of its
 * front. Not collective. */
#ifndef KILN_COORDINATOR_VIEW_TEXEL_PLACE_H
#define KILN_COORDINATOR_VIEW_TEXEL_PLACE_H

#include "worker/scene/scene.h"

struct kiln_texel_place {
    uint32_t object, x, y;
};

/* The object's name is what stands before the last two commas; of several objects of that name it is the first.
 * KILN_USAGE: it is no such text, or the scene has no object of that name. */
int kiln_texel_place_read(struct kiln_texel_place *place, const struct kiln_scene *scene, const char *texel,
                          struct kiln_error *error);

/* KILN_USAGE, and the sentence: no surface lies there. */
int kiln_texel_place_refuse(const char *texel, struct kiln_error *error);

#endif
