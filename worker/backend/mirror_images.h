/* Mirror images of lamps: light of a lamp without extent by one reflection at a plane needs no path search. It comes
 * from the lamp's mirror image, along one path for each lamp and plane, and is as smooth as direct light.
 *
 * A lamp is a point, a spot or a directional light. A plane is the set of world triangles that lie in it, face one way
 * and reflect as a mirror: their material has simulated gloss (kiln_scene_take_gloss), is smooth everywhere and has no
 * clear coat, and their shading normals are the plane's. Only fronts count. A mirror may be metal, a polished floor, or
 * the near side of a pane of glass with a body; other scattering of such a material is computed elsewhere.
 *
 * The planes of the largest area are used, with at most KILN_IMAGES_MOST pairs of a lamp and a plane in all. If a
 * spot's beam is narrow where it reaches such a plane, no images are used at all: hardly any of a texel's samples would
 * lie in the beam, while light paths find it however narrow it is. Paths of these pairs are found only by images: light
 * paths (land.h) and gather rays (weighed.h) leave them out. The images are a pure function of scene and lights. Built
 * once and only read afterwards: thread-safe. */
#ifndef KILN_WORKER_BACKEND_MIRROR_IMAGES_H
#define KILN_WORKER_BACKEND_MIRROR_IMAGES_H

#include "worker/base/arena.h"
#include "worker/light/lights.h"

enum { KILN_IMAGES_MOST = 16 };

struct kiln_mirror_plane {
    struct kiln_dvec3 normal;           /* unit, of the front */
    double distance;                    /* m: n.p for places p of the plane, relative to the scene's centre */
    struct kiln_dvec3 minimum, maximum; /* m: bounding box of its triangles */
    double area;                        /* m2 */
};

struct kiln_mirror_lamp {
    bool outside;            /* directional */
    uint32_t index;          /* index in lights->points or lights->directionals */
    struct kiln_dvec3 place; /* position, m; directional: unit vector towards the lamp */
};

struct kiln_mirror_images {
    const struct kiln_lights *lights; /* borrowed */
    size_t lamp_count, plane_count;
    struct kiln_mirror_lamp *lamps;
    struct kiln_mirror_plane *planes; /* the largest first */
    uint32_t *plane_of;               /* plane of each world triangle; KILN_NONE: none */
    struct kiln_arena arena;
};

/* Creates the images; *images is NULL if there is no pair, or a spot's beam has a cross-section below `least` m2 where
 * its axis meets a plane. Not collective. Borrows the lights. KILN_SYSTEM. Destroy with kiln_mirror_images_destroy. */
int kiln_mirror_images_create(struct kiln_mirror_images **images, const struct kiln_lights *lights, double least,
                              struct kiln_error *error);
void kiln_mirror_images_destroy(struct kiln_mirror_images **images);

/* Finds the unit direction in which a place p sees a lamp in a plane; false: it does not. Occlusion is not tested. */
bool kiln_mirror_image(const struct kiln_mirror_plane *plane, const struct kiln_mirror_lamp *lamp, struct kiln_dvec3 p,
                       struct kiln_dvec3 *direction);
/* Whether the lamp may be visible in the plane from some place of the box, m; if not, kiln_mirror_image is false for
 * all its places. `extent`: of the world, m. */
bool kiln_mirror_may_show(const struct kiln_mirror_plane *plane, const struct kiln_mirror_lamp *lamp,
                          struct kiln_dvec3 minimum, struct kiln_dvec3 maximum, double extent);

#endif
