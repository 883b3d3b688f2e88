/* A picture of a bake: primary rays through a pinhole, surfaces shaded from the published lightmaps.
 *
 * Radiance of a pixel is the mean over a fixed grid of sub-pixel rays of albedo x E / pi + emission at the first hit, E looked up
 * bilinearly in DIR/lightmaps/OBJECT.exr (read when first needed; all lightmaps in view stay in memory, 12 bytes a texel), and the
 * environment where a ray leaves the scene. Single-sided surfaces are seen from the front only, as glTF has it: a ray that meets
 * one from behind goes on, so a closed room can be looked into from outside. Caster-only objects, which have no
 * lightmap, are seen only where they emit; receiver-only ones are seen when the geometry was told so (kiln_geometry_meet_all). Not collective; deterministic for one backend and
 * instruction set. */
#ifndef KILN_COORDINATOR_OUTPUT_VIEW_H
#define KILN_COORDINATOR_OUTPUT_VIEW_H

#include "coordinator/output/image.h"
#include "worker/backend/backend.h"
#include "worker/light/lights.h"

struct kiln_view_camera {
    struct kiln_dvec3 position;            /* m, relative to the scene's centre */
    struct kiln_dvec3 right, up, forward;  /* unit */
    double extent_x, extent_y; /* half the picture's size at distance 1; in metres when orthographic */
    bool orthographic;
};

/* What is asked for; zero or NULL means default in every field. */
struct kiln_view_wish {
    const char *camera;         /* name of a camera of the scene; default: the first, else one that frames the whole scene */
    const double *from, *to;    /* world, m: eye and target; to alone turns the camera, from alone looks at the scene's middle */
    double field_of_view;       /* degrees, vertical; default: the camera's, or 45 */
    uint32_t width, height;     /* pixels; default 960 and what the camera's aspect (or 4:3) makes of it */
};

/* Decides camera and size. KILN_USAGE when there is no camera of that name (the sentence lists those there are), or when eye
 * and target coincide. */
int kiln_view_aim(const struct kiln_scene *scene, const struct kiln_view_wish *wish, struct kiln_view_camera *camera, uint32_t *width,
                  uint32_t *height, struct kiln_error *error);

struct kiln_view_params {
    const char *directory; /* of the bake: lightmaps are read from it */
    const struct kiln_scene *scene;
    const struct kiln_geometry *geometry;
    const struct kiln_lights *lights; /* for the environment; NULL: black */
    struct kiln_backend *backend;
    struct kiln_view_camera camera;
    uint32_t width, height;
    uint32_t side; /* side x side rays a pixel; 0: 3 */
};

/* Renders channels R G B, W m-2 sr-1. KILN_BAD_INPUT or KILN_NO_INPUT when a lightmap does not belong to the scene or is missing. */
int kiln_view_render(const struct kiln_view_params *params, struct kiln_image **image, struct kiln_error *error);

/* DIR/preview.png from the lightmaps published in DIR, with the default camera. `stops` is added to the automatic exposure. */
int kiln_view_preview(const char *directory, const struct kiln_scene *scene, const struct kiln_geometry *geometry,
                      const struct kiln_lights *lights, struct kiln_backend *backend, double stops, struct kiln_error *error);

#endif
