/* Short answers of the passes that light surface points: the members of struct kiln_point_result that a device returns,
 * and conversion to the whole struct, whose other members the host knows. shaders/shared/layout.h has the layout. */
#ifndef KILN_WORKER_BACKEND_VULKAN_ANSWERS_H
#define KILN_WORKER_BACKEND_VULKAN_ANSWERS_H

#include "worker/backend/vulkan/vulkan.h"
#include "worker/pass/point.h"

/* Value of the second kernel's own specialisation constant: its answers are short. */
enum { VULKAN_SHORT = 1 };

/* Parts that a short answer has. */
struct vulkan_answer {
    bool rays;  /* numbers of escaped and of blocked rays */
    bool whole; /* both numbers are in one word */
    bool mixed, tints, gloss, alpha;
    size_t words;
};

/* Returns the parts of the gather pass's answers with this number of samples. */
struct vulkan_answer vulkan_answer_of_gather(const struct vulkan_backend *b, uint32_t samples);
/* Returns the parts of the direct pass's answers, whose rays are returned separately. */
struct vulkan_answer vulkan_answer_of_direct(const struct vulkan_backend *b);

/* Converts the short answers of a tile run, at `from`, to results (struct kiln_point_result). Several threads may call
 * it at once. */
typedef void (*vulkan_lengthen)(const struct vulkan_backend *b, const struct kiln_batch *batch, size_t tile_run,
                                const void *from, void *to);
void vulkan_lengthen_gather(const struct vulkan_backend *b, const struct kiln_batch *batch, size_t tile_run,
                            const void *from, void *to);
void vulkan_lengthen_direct(const struct vulkan_backend *b, const struct kiln_batch *batch, size_t tile_run,
                            const void *from, void *to);

/* Converts short results of consecutive tile runs, `bytes` a point, and hands them to the batch's taker, in portions
 * that fit the caches. A status of the taker other than KILN_OK ends it. */
int vulkan_take_short(struct vulkan_backend *b, vulkan_lengthen lengthen, size_t bytes, const struct kiln_batch *batch,
                      size_t tile_run_first, size_t tile_run_count, const void *results, struct kiln_error *error);

#endif
