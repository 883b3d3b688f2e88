/* Path-traced views: the reference for what views of a bake show. The path pass (worker/pass/path.h) computes pixels;
 * here they are asked for in order, and added up. Nothing here is collective. */
#ifndef KILN_COORDINATOR_VIEW_PATH_VIEW_H
#define KILN_COORDINATOR_VIEW_PATH_VIEW_H

#include "coordinator/view/view.h"
#include "worker/pass/bidirectional.h"

/* A picture, and how it is to be traced. */
struct kiln_path_view {
    struct kiln_path_parameters parameters;
    uint32_t samples; /* paths of a pixel, at least 1 */
    uint32_t first;   /* number of the first of them */
    bool both_ways;   /* by bidirectional paths */
    /* of these: how, and the radius of merging at first, m */
    enum kiln_bidirectional_method method;
    double radius;
};

/* The view of this camera by paths from the camera alone, with `bounces` indirect bounces; below 0: all. */
struct kiln_path_view kiln_path_view_of(const struct kiln_view_camera *camera, uint32_t width, uint32_t height,
                                        int64_t bounces, uint32_t samples);

/* Progress callback and stop flag. */
struct kiln_path_progress {
    void (*tell)(void *context, double share); /* of the pixels' paths that are done, 0 to 1; NULL: nobody is told */
    void *context;
    const struct kiln_stop *stop; /* may ask to stop; NULL: never */
};

/* Sums over the paths of a range of pixels, which can grow: radiance, and squares of luminances. */
struct kiln_path_sum {
    double radiance[3], square;
};
struct kiln_path_sums {
    size_t first, count;          /* pixels, row by row from the top */
    uint32_t samples;             /* paths of each that are in the sums */
    struct kiln_path_sum *pixels; /* owned */
};
/* No paths yet. Release with kiln_path_sums_destroy, also after a failure. */
int kiln_path_sums_create(struct kiln_path_sums *sums, size_t first, size_t count, struct kiln_error *error);
void kiln_path_sums_destroy(struct kiln_path_sums *sums);
/* Adds the next `samples` paths of each pixel. Sums of floats have an order: the bits depend on the numbers of paths
 * that are added in one call, and on nothing else; ranges do not matter. The other arguments are those of
 * kiln_path_view_pixels. After a failure the sums are of no use. */
int kiln_path_sums_add(struct kiln_path_sums *sums, struct kiln_backend *backend, const struct kiln_path_view *view,
                       uint32_t samples, const struct kiln_path_progress *progress, struct kiln_splat_film *film,
                       uint64_t *rays, struct kiln_error *error);
/* The means: three floats a pixel, and unless `errors` is NULL the standard error of each pixel's luminance. */
void kiln_path_sums_develop(const struct kiln_path_sums *sums, float *rgb, float *errors);

/* Computes the radiance of pixels [first, first + count), row by row from the top: three floats each in `rgb`. Any
 * ranges give the same bits. `errors`, if it is not NULL, gets the standard error of each pixel's luminance. Adds the
 * rays to *rays. `film`: of the whole picture, for bidirectional paths: gets what the range's paths of light
 * bring to any pixel, which `rgb` and `errors` lack; else NULL. KILN_STOPPED, or the status of the backend. */
int kiln_path_view_pixels(struct kiln_backend *backend, const struct kiln_path_view *view, size_t first, size_t count,
                          const struct kiln_path_progress *progress, struct kiln_splat_film *film, float *rgb,
                          float *errors, uint64_t *rays, struct kiln_error *error);

/* Adds a film, to which all ranges have added `samples` paths of each pixel, to the whole picture. */
void kiln_path_view_add_film(const struct kiln_path_view *view, uint32_t samples, const struct kiln_splat_film *film,
                             float *rgb);

/* Refuses scenes with receiver-only objects (KILN_OBJECT_RECEIVER_ONLY), which rays would have to see from the camera
 * and nowhere else. KILN_USAGE. */
int kiln_path_view_check(const struct kiln_scene *scene, struct kiln_error *error);

/* Whether paths from the camera alone miss light of the scene: that of points, spots and directional lights by way of
 * mirrors and smooth glass, which no ray meets by chance. Of a scene whose materials are taken (kiln_scene_take_gloss).
 */
bool kiln_path_view_misses(const struct kiln_scene *scene, const struct kiln_lights *lights);

#endif
