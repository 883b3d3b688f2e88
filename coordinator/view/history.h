/* Temporal reprojection: accumulates the pixels of a moving camera over frames (Koskela et al., "Blockwise Multi-Order
 * Feature Regression for Real-Time Path-Tracing Reconstruction", ACM TOG 38(5), 2019, section 3.1; Scherzer, Jeschke
 * and Wimmer, "Pixel-correct shadow maps with temporal reprojection and shadow test confidence", EGSR 2007).
 *
 * The position that a pixel sees is projected onto the previous frame, where it lies between four pixels. Their values
 * are interpolated bilinearly. A pixel that sees another surface is left out: its position is further from the tangent
 * plane than two pixel widths there, or its normal deviates by more than 25 degrees. Surroundings are matched with
 * surroundings, along the same direction. With n frames accumulated, a pixel becomes the mean
 *
 *     value = a new + (1 - a) before,    a = max(1 / (n + 1), floor)
 *
 * which is the mean of all frames as long as 1 / (n + 1) > floor. If all four pixels are left out, the pixel starts
 * over. Positions in the previous frame are rounded to a 64th of a pixel, so that a camera at rest finds exactly the
 * same pixels.
 *
 * Not collective; the same bits for any number of threads. */
#ifndef KILN_COORDINATOR_VIEW_HISTORY_H
#define KILN_COORDINATOR_VIEW_HISTORY_H

#include "coordinator/view/view.h"

/* A frame. All planes have width x height values, row by row, and are borrowed. */
struct kiln_frame {
    struct kiln_view_camera camera;
    uint32_t width, height;
    double place;             /* sample point of positions in a pixel: offset from its upper left corner, pixels */
    const float *normal[3];   /* about 1 long */
    const float *position[3]; /* m, in the camera's coordinates; only of pixels that see a surface */
    const bool *surface;      /* whether the pixel sees a surface */
    const bool *bound;        /* whether the content of the pixel moves with the camera, as in mirrors: it is not
                               * reprojected, neither from nor to other frames, unless the camera is at rest */
};

struct kiln_history;

/* For frames of `width` x `height` pixels. KILN_SYSTEM. */
int kiln_history_create(struct kiln_history **history, uint32_t width, uint32_t height, struct kiln_error *error);
void kiln_history_destroy(struct kiln_history **history);

/* Finds the matching pixels of the previous frame for each pixel of the new frame. Then stores the new frame as the
 * previous one. */
void kiln_history_find(struct kiln_history *history, const struct kiln_frame *frame);

/* Accumulated planes of the previous frames: `count` planes, and for each pixel the number of frames in them. */
enum { KILN_HISTORY_MOST = 4 };
struct kiln_layer {
    size_t count;
    float *planes[KILN_HISTORY_MOST];
    float *frames;
};

int kiln_layer_create(struct kiln_layer *layer, const struct kiln_history *history, size_t count,
                      struct kiln_error *error);
void kiln_layer_destroy(struct kiln_layer *layer);

/* Blends `planes`, the layer->count planes of the frame of the last kiln_history_find, with the layer: both become the
 * means over frames. With `variance` the last plane is the variance of the others and is weighted with squared weights,
 * as for independent noise of pixels. KILN_SYSTEM. */
int kiln_layer_blend(struct kiln_layer *layer, const struct kiln_history *history, double floor, bool variance,
                     float *const *planes, struct kiln_error *error);

#endif
