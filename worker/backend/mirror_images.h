/* Images of lamps in flat mirrors: light that a texel gets from a lamp without extent by one reflection at a plane
 * needs no search. It comes from the lamp's mirror image, one way for each lamp and plane, and is as smooth as light
 * that comes straight.
 *
 * A lamp is a point, a spot or a directional light. A plane is what of the world's triangles lies in it, faces one way,
 * and reflects as a mirror: its material is taken with its gloss (kiln_scene_take_gloss), is smooth all over, has no
 * clear coat, and its shading normals are the plane's. Only fronts count. A mirror may be metal, a polished floor, or
 * the near side of a pane of glass with a body; what else such a material does is left to others.
 *
 * Of all planes those of the largest area are taken, of KILN_IMAGES_MOST pairs of a lamp and a plane together at most.
 * Where a spot's beam is narrow as it comes to such a plane there are no images at all: of a texel's samples hardly any
 * would lie in its light, and paths land there however narrow it is. That the paths of these pairs are found by images
 * alone is what light paths (land.h) and gather rays (weighed.h) agree on. A pure function of scene and lights. Built
 * once and only read afterwards: thread-safe. */
#ifndef KILN_WORKER_BACKEND_MIRROR_IMAGES_H
#define KILN_WORKER_BACKEND_MIRROR_IMAGES_H

#include "worker/base/arena.h"
#include "worker/light/lights.h"

enum { KILN_IMAGES_MOST = 16 };

struct kiln_mirror_plane {
    struct kiln_dvec3 normal;           /* unit, of the front */
    double distance;                    /* m: n.p of its places p, relative to the scene's centre */
    struct kiln_dvec3 minimum, maximum; /* m: about its triangles */
    double area;                        /* m2 */
};

struct kiln_mirror_lamp {
    bool outside;            /* directional */
    uint32_t index;          /* among lights->points, or lights->directionals */
    struct kiln_dvec3 place; /* m; of one that is outside the unit vector towards it */
};

struct kiln_mirror_images {
    const struct kiln_lights *lights; /* borrowed */
    size_t lamp_count, plane_count;
    struct kiln_mirror_lamp *lamps;
    struct kiln_mirror_plane *planes; /* the largest first */
    uint32_t *plane_of;               /* of each world triangle; KILN_NONE: of no plane that is taken */
    struct kiln_arena arena;
};

/* NULL where there is no pair, or a spot's beam has less than `least` m2 across where its axis meets a plane. Not
 * collective. Borrows the lights. KILN_SYSTEM. Destroy with
 * kiln_mirror_images_destroy. */
int kiln_mirror_images_create(struct kiln_mirror_images **images, const struct kiln_lights *lights, double least,
                              struct kiln_error *error);
void kiln_mirror_images_destroy(struct kiln_mirror_images **images);

/* The direction, unit, in which a place p sees a lamp in a plane, and where; false: it does not, whatever lies between
 * them. */
bool kiln_mirror_image(const struct kiln_mirror_plane *plane, const struct kiln_mirror_lamp *lamp, struct kiln_dvec3 p,
                       struct kiln_dvec3 *direction);
/* Whether a place of the box, m, may see the lamp in the plane: kiln_mirror_image is false for all of its places, else.
 * `extent`: of the world, m. */
bool kiln_mirror_may_show(const struct kiln_mirror_plane *plane, const struct kiln_mirror_lamp *lamp,
                          struct kiln_dvec3 minimum, struct kiln_dvec3 maximum, double extent);

#endif
