/* Path-traced views: reference pictures for views of a bake. The path pass (worker/pass/path.h) computes pixels; this
 * module requests them in order and accumulates their paths. Nothing here is collective. */
#ifndef KILN_COORDINATOR_VIEW_PATH_VIEW_H
#define KILN_COORDINATOR_VIEW_PATH_VIEW_H

#include "coordinator/view/view.h"
#include "worker/pass/bidirectional.h"

/* Parameters of a path-traced picture. */
struct kiln_path_view {
    struct kiln_path_parameters parameters;
    uint32_t samples; /* paths per pixel, at least 1 */
    uint32_t first;   /* number of the first path */
    bool both_ways;   /* bidirectional path tracing */
    /* for bidirectional paths: the method, and the initial radius of vertex merging, m */
    enum kiln_bidirectional_method method;
    double radius;
};

/* Makes the parameters for path tracing from the camera alone, with `bounces` indirect bounces; below 0: all. */
struct kiln_path_view kiln_path_view_of(const struct kiln_view_camera *camera, uint32_t width, uint32_t height,
                                        int64_t bounces, uint32_t samples);

/* Progress callback and stop flag. */
struct kiln_path_progress {
    void (*tell)(void *context, double share); /* `share`: finished fraction of all paths, 0 to 1; NULL: no report */
    void *context;
    const struct kiln_stop *stop; /* may ask to stop; NULL: never */
};

/* Sums over the paths of a range of pixels, which can grow: radiance, and squares of luminances. */
struct kiln_path_sum {
    double radiance[3], square;
};
struct kiln_path_sums {
    size_t first, count;          /* pixels, row by row from the top */
    uint32_t samples;             /* paths per pixel in the sums */
    struct kiln_path_sum *pixels; /* owned */
};
/* No paths yet. Release with kiln_path_sums_destroy, also after a failure. */
int kiln_path_sums_create(struct kiln_path_sums *sums, size_t first, size_t count, struct kiln_error *error);
void kiln_path_sums_destroy(struct kiln_path_sums *sums);
/* Adds the next `samples` paths of each pixel. Since float addition is not associative, the bits depend on the numbers
 * of paths added in each call, but on nothing else, such as the ranges. The other arguments are those of
 * kiln_path_view_pixels. After a failure the sums are unusable. */
int kiln_path_sums_add(struct kiln_path_sums *sums, struct kiln_backend *backend, const struct kiln_path_view *view,
                       uint32_t samples, const struct kiln_path_progress *progress, struct kiln_splat_film *film,
                       uint64_t *rays, struct kiln_error *error);
/* Computes the mean radiance, three floats per pixel, and unless `errors` is NULL the standard error of each pixel's
 * luminance. */
void kiln_path_sums_develop(const struct kiln_path_sums *sums, float *rgb, float *errors);

/* Computes the radiance of pixels [first, first + count), row by row from the top: three floats each in `rgb`. Any
 * ranges give the same bits. `errors`, if not NULL, receives the standard error of each pixel's luminance. Adds the
 * number of rays to *rays. `film`, of the whole picture, is for bidirectional paths, else NULL: the light paths of the
 * range are splatted to it, at any pixel; `rgb` and `errors` exclude them. KILN_STOPPED, or the backend's status. */
int kiln_path_view_pixels(struct kiln_backend *backend, const struct kiln_path_view *view, size_t first, size_t count,
                          const struct kiln_path_progress *progress, struct kiln_splat_film *film, float *rgb,
                          float *errors, uint64_t *rays, struct kiln_error *error);

/* Adds a film, to which all ranges have added `samples` paths of each pixel, to the whole picture. */
void kiln_path_view_add_film(const struct kiln_path_view *view, uint32_t samples, const struct kiln_splat_film *film,
                             float *rgb);

/* Refuses scenes with receiver-only objects (KILN_OBJECT_RECEIVER_ONLY) with KILN_USAGE: camera rays would have to hit
 * them and other rays not. */
int kiln_path_view_check(const struct kiln_scene *scene, struct kiln_error *error);

/* Tells whether paths from the camera alone miss light of the scene: light of point, spot and directional lights via
 * mirrors and smooth glass, which no random ray meets. The materials must be taken (kiln_scene_take_gloss). */
bool kiln_path_view_misses(const struct kiln_scene *scene, const struct kiln_lights *lights);

#endif
