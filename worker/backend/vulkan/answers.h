/* Short answers of the passes that light surface points: what a device hands over of struct kiln_point_result, and the
 * rest, which the host knows. The layout stands in shaders/shared/layout.h. */
#ifndef KILN_WORKER_BACKEND_VULKAN_ANSWERS_H
#define KILN_WORKER_BACKEND_VULKAN_ANSWERS_H

#include "worker/backend/vulkan/vulkan.h"
#include "worker/pass/point.h"

/* In the place of a second kernel's own constant: its answers are short. */
enum { VULKAN_SHORT = 1 };

/* Parts that a short answer has. */
struct vulkan_answer {
    bool rays;  /* how many have escaped and were blocked */
    bool whole; /* these are in one word */
    bool mixed, tints, gloss, alpha;
    size_t words;
};

/* Parts of the gather pass's answers with so many samples. */
struct vulkan_answer vulkan_answer_of_gather(const struct vulkan_backend *b, uint32_t samples);
/* Parts of the direct pass's answers, whose rays come back on their own. */
struct vulkan_answer vulkan_answer_of_direct(const struct vulkan_backend *b);

/* Makes results (struct kiln_point_result) of the short ones of a tile run, at `from`. May be called by several threads
 * at once. */
typedef void (*vulkan_lengthen)(const struct vulkan_backend *b, const struct kiln_batch *batch, size_t tile_run,
                                const void *from, void *to);
void vulkan_lengthen_gather(const struct vulkan_backend *b, const struct kiln_batch *batch, size_t tile_run,
                            const void *from, void *to);
void vulkan_lengthen_direct(const struct vulkan_backend *b, const struct kiln_batch *batch, size_t tile_run,
                            const void *from, void *to);

/* Hands short results of consecutive tile runs, `bytes` a point, to the batch's taker: so many at once as stay in the
 * caches. What the taker returns but for KILN_OK ends it. */
int vulkan_take_short(struct vulkan_backend *b, vulkan_lengthen lengthen, size_t bytes, const struct kiln_batch *batch,
                      size_t tile_run_first, size_t tile_run_count, const void *results, struct kiln_error *error);

#endif
