/* The frames before: what the pixels of a moving camera take over from them, by reprojection (Koskela et al.,
 * "Blockwise Multi-Order Feature Regression for Real-Time Path-Tracing Reconstruction", ACM TOG 38(5), 2019, section
 * 3.1; Scherzer, Jeschke and Wimmer, "Pixel-correct shadow maps with temporal reprojection and shadow test confidence",
 * EGSR 2007).
 *
 * The place that a pixel sees is projected onto the frame before, where it lies between four pixels. Their values are
 * interpolated bilinearly, without those that see something else: that lie further from the pixel's tangent plane than
 * two pixels are wide there, or whose normal is more than 25 degrees off. Surroundings meet surroundings, along the
 * same direction. A pixel n of whose frames are known then is the mean
 *
 *     value = a new + (1 - a) before,    a = max(1 / (n + 1), floor)
 *
 * which is that of all frames as long as 1 / (n + 1) > floor. A pixel without any such four begins anew. Places in the
 * frame before are rounded to a 64th of a pixel, so that a camera that stands still finds each pixel as it was.
 *
 * Not collective; the same bits for any number of threads. */
#ifndef KILN_COORDINATOR_VIEW_HISTORY_H
#define KILN_COORDINATOR_VIEW_HISTORY_H

#include "coordinator/view/view.h"

/* A frame. All planes have width x height values, row by row, and are borrowed. */
struct kiln_frame {
    struct kiln_view_camera camera;
    uint32_t width, height;
    double place;             /* where in a pixel positions are taken, from its upper left corner, pixels */
    const float *normal[3];   /* about 1 long */
    const float *position[3]; /* m, as the camera's; of pixels that see a surface */
    const bool *surface;      /* whether the pixel sees one */
    const bool *bound;        /* whether what it shows moves with the camera, as in mirrors: such pixels take nothing
                               * over, and nothing is taken from them, unless the camera stands still */
};

struct kiln_history;

/* For frames of `width` x `height` pixels. KILN_SYSTEM. */
int kiln_history_create(struct kiln_history **history, uint32_t width, uint32_t height, struct kiln_error *error);
void kiln_history_destroy(struct kiln_history **history);

/* Finds for each pixel of the new frame those of the frame before, and remembers the new one in its place. */
void kiln_history_find(struct kiln_history *history, const struct kiln_frame *frame);

/* Data from the frames before: `count` planes, and for each pixel the number of frames in them. */
enum { KILN_HISTORY_MOST = 4 };
struct kiln_layer {
    size_t count;
    float *planes[KILN_HISTORY_MOST];
    float *frames;
};

int kiln_layer_create(struct kiln_layer *layer, const struct kiln_history *history, size_t count,
                      struct kiln_error *error);
void kiln_layer_destroy(struct kiln_layer *layer);

/* Makes `planes`, layer->count ones of the frame that was found last, means over frames, and keeps these. With
 * `variance` the last plane is a variance of the others: the squares of all weights go with it, as if pixels had noise
 * of their own. KILN_SYSTEM. */
int kiln_layer_blend(struct kiln_layer *layer, const struct kiln_history *history, double floor, bool variance,
                     float *const *planes, struct kiln_error *error);

#endif
