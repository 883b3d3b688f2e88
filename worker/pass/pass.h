/* Passes: kinds of ray-traced computations over many items, with one result an item. Each pass is a row of a table.
 *
 * A pass takes parameters of its own and a batch (the items, their samples, the random stream) and gives an array of
 * results, one an item. What a particular pass takes and gives, with its formula and units, stands in its own header:
 * validity.h, direct.h, gather.h, probes.h, occlusion.h, directional.h, path.h, radiance.h, guided.h, caustic.h,
 * land.h, bidirectional.h, weighed.h, reference.h, shapes.h, patches.h, links.h, directions.h. kiln_backend_run
 * (worker/backend/backend.h) runs any of them.
 *
 * A new pass called NAME is: NAME in KILN_PASS_LIST_OF_ALL below, a row in passes.c, a header NAME.h in this folder,
 * and a file NAME.c in each backend's folder with what the backend's header declares for every name of the list: the
 * function embree_NAME (worker/backend/embree/embree.h), the row vulkan_pass_NAME (worker/backend/vulkan/vulkan.h). The
 * neutral layer, the fallback and the verifying backend walk the table and know no pass by name.
 *
 * Determinism: a result is a function of (seed, item, stream, samples, parameters) and the scene alone. Any batch,
 * number of threads or rank gives the same bits. */
#ifndef KILN_WORKER_PASS_PASS_H
#define KILN_WORKER_PASS_PASS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"
#include "worker/base/vector.h"

/* Names of all passes: first passes that every backend has, then passes of CPU backends only, which devices refuse with
 * KILN_USAGE. */
#define KILN_PASS_LIST_OF_ALL(DO)                                                                                      \
    DO(validity)                                                                                                       \
    DO(direct)                                                                                                         \
    DO(gather)                                                                                                         \
    DO(probes)                                                                                                         \
    DO(occlusion)                                                                                                      \
    DO(directional)                                                                                                    \
    DO(path)                                                                                                           \
    DO(radiance)                                                                                                       \
    DO(guided)                                                                                                         \
    DO(caustic) DO(land) DO(bidirectional) DO(weighed) DO(reference) DO(patches) DO(links) DO(directions)
#define KILN_PASS_LIST_OF_PROCESSORS(DO) DO(shapes)
#define KILN_PASS_LIST(DO) KILN_PASS_LIST_OF_ALL(DO) KILN_PASS_LIST_OF_PROCESSORS(DO)

/* Index of a pass in kiln_passes: KILN_PASS_INDEX_direct and so on. */
#define KILN_PASS_INDEX_OF(name) KILN_PASS_INDEX_##name,
enum kiln_pass_index { KILN_PASS_LIST(KILN_PASS_INDEX_OF) KILN_PASS_COUNT };
#undef KILN_PASS_INDEX_OF

/* Kinds of items of a pass. */
enum kiln_pass_domain {
    /* An item is a tile run (worker/scene/surface.h) of the surface that the backend has; its results are one for each
     * of the tile run's points, in order. */
    KILN_DOMAIN_TILE_RUNS,
    /* An item is a position in space; it has one result. */
    KILN_DOMAIN_POSITIONS,
    /* An item is a pixel of the camera that the parameters describe; it has one result. */
    KILN_DOMAIN_PIXELS,
    /* An item is a path of light that begins at a lamp; it has one result. */
    KILN_DOMAIN_LIGHT_PATHS
};

/* Figures of one result, means over samples. The verifying backend compares them with another backend's. */
enum { KILN_PASS_FIGURES = 6 };
struct kiln_pass_figures {
    uint32_t count; /* samples that the result is of; 0: the point is not valid */
    double level;   /* the figure that stands for the whole result, in the pass's unit: a luminance, a share */
    double error;   /* its standard error, same unit; 0: unknown */
    float value[KILN_PASS_FIGURES]; /* all figures: kiln_pass.figure_count of them */
    bool sound;                     /* all figures are finite and not below their possible minimum */
};

/* A row of the table. */
struct kiln_pass {
    enum kiln_pass_index index;
    const char *name; /* as in KILN_PASS_LIST */
    const char *what; /* name of its result in messages: "direct light" */
    enum kiln_pass_domain domain;
    size_t parameter_bytes; /* of its struct of parameters; 0: it has none, NULL is given */
    size_t result_bytes;    /* of one result */
    bool is_sampled;        /* it uses kiln_batch.samples; else that is 0 and the number is fixed */
    bool has_streams;       /* it uses kiln_batch.stream; else that is 0 */
    bool is_divisible;      /* it uses kiln_batch.first_sample; else that is 0 */
    bool is_masked;         /* it takes kiln_batch.selections; else that is NULL */
    bool reads_radiosity;   /* kiln_backend_set_radiosity must come before it */
    /* Returns the colour channels of a result for which some radiosity was absent (worker/scene/radiosity.h): bit 0
     * red, 1 green, 2 blue; 0: none. NULL: the pass cannot detect this, so all radiosity must be present. */
    uint32_t (*lacks)(const void *result);
    /* A rank may run it on tile runs of another rank of its node (work stealing): it needs only that rank's surface,
     * and exchanged data do not depend on which rank ran it. */
    bool is_stealable;
    bool is_whole; /* a batch is never split: its items share a common precomputation */
    /* Comparison of results, for the verifying backend. NULL: results are not verified; then the rest is unused. */
    void (*figures)(const void *result, struct kiln_pass_figures *figures);
    size_t figure_count;                         /* at most KILN_PASS_FIGURES */
    const char *figure_names[KILN_PASS_FIGURES]; /* in messages: "irradiance" */
    const char *unit;                            /* of `level`, in messages: "W/m2" */
};

/* The rows, one object for each name of the list (kiln_pass_direct and so on), and all of them in order. */
#define KILN_PASS_DECLARE(name) extern const struct kiln_pass kiln_pass_##name;
KILN_PASS_LIST(KILN_PASS_DECLARE)
#undef KILN_PASS_DECLARE
extern const struct kiln_pass *const kiln_passes[KILN_PASS_COUNT];

/* Passes over tile runs whose samples are counted give sums over a point's samples, and their number. This is the mean
 * of `count` samples with the sum `sum`, 0 of none. With a power of two it is exact: the sum's rounding is the only
 * one. */
static inline float kiln_mean(float sum, uint32_t count)
{
    return count > 0 ? (float)((double)sum / (double)count) : 0.0f;
}

/* Takes results. Called on the thread that called kiln_backend_run, for consecutive parts of a batch, in order, while a
 * device may already be busy with the next part. `first` and `count` are items. `results` points to an array of the
 * pass's result struct, for all points of the tile runs or for each position or pixel, in order; it is only lent until
 * the call returns. A status other than KILN_OK ends the run with that status. If items have different numbers of
 * samples, order is kept only among items with the same number. */
typedef int (*kiln_take_results)(void *context, size_t first, size_t count, const void *results,
                                 struct kiln_error *error);

/* Takes results among which are those of items that the batch leaves out: `samples` has the samples of each item, and
 * an item with 0 is skipped, for its results are undefined. All else as kiln_take_results. */
typedef int (*kiln_take_some)(void *context, size_t first, size_t count, const uint32_t *samples, const void *results,
                              struct kiln_error *error);

/* Work stealing: other ranks may take items of a batch that were not begun. Before each part, claim() is called with
 * its items [first, first + count) and returns how many of them, from the first on, this backend computes. It is called
 * again for the remaining ones; 0 ends the run. Called on the thread of kiln_backend_run, in order. */
struct kiln_claims {
    size_t (*claim)(void *context, size_t first, size_t count);
    void *context;
};

/* Points of one tile run: bit k stands for its k-th. */
struct kiln_selection {
    uint64_t computed;
    uint64_t few; /* those of them that have fewer samples than the others (kiln_batch_few) */
};

/* A range of items, and the settings and receiver of their results. Any length: a backend splits it to suit its device.
 */
struct kiln_batch {
    size_t first, count; /* items. Tile runs: of the backend's surface. Positions: numbers among all positions; the
                          * random numbers depend on them */
    const struct kiln_vec3
        *positions;   /* `count` positions, m from the scene's centre; NULL unless items are positions */
    uint32_t stream;  /* tells runs of one pass apart in the random numbers */
    uint32_t samples; /* of every point or position */
    /* The samples are first_sample, first_sample + 1, ... of an endless sequence. Several batches that take consecutive
     * stretches of it are together as well distributed as one batch. */
    uint32_t first_sample;
    /* NULL: all items have `samples`. Else `count` numbers, one an item, for adaptive sampling; an item with 0 is left
     * out (not computed, not passed to `take`). An item's results have the same bits as in a batch where all items have
     * its number. If the backend needs one number for this pass, kiln_backend_run runs the batch once for each number;
     * then few different numbers are faster. */
    const uint32_t *samples_each;
    /* NULL: all points of a tile run are computed. Else `count`, one a tile run. The result of a computed point is the
     * same bits as without; of one of few samples, as in a batch of that many. The others' results are all zeros, as
     * those of points that are not valid. */
    const struct kiln_selection *selections;
    bool may_lack;                    /* some radiosity may be absent: `take` checks with kiln_pass.lacks */
    const struct kiln_claims *claims; /* NULL: all items are computed */
    kiln_take_results take;           /* NULL: results are dropped */
    /* NULL: items that are left out interrupt what `take` gets, and thousands of calls of a few tile runs are slow */
    kiln_take_some take_some;
    void *context; /* given to both */
};

static inline bool kiln_batch_leaves_out(const struct kiln_batch *batch, size_t item)
{
    return batch->samples_each != NULL && batch->samples_each[item - batch->first] == 0;
}

/* Mask of the points of a tile run that are computed, bit k for its k-th point. */
static inline uint64_t kiln_batch_points(const struct kiln_batch *batch, size_t item)
{
    return batch->selections != NULL ? batch->selections[item - batch->first].computed : UINT64_MAX;
}

/* Whether some computed points have fewer samples than others. */
static inline bool kiln_batch_has_few(const struct kiln_batch *batch)
{
    size_t i = 0;
    while (batch->selections != NULL && i < batch->count && batch->selections[i].few == 0)
        i++;
    return batch->selections != NULL && i < batch->count;
}

/* The samples of points of few samples where others have `samples`: an eighth, two at least. */
static inline uint32_t kiln_batch_few(uint32_t samples)
{
    return samples >= 16 ? samples / 8 : samples < 2 ? samples : 2;
}

/* Returns the end, at most `end`, of the longest stretch of items from `first` on that are all left out or all
 * computed. */
static inline size_t kiln_batch_stretch(const struct kiln_batch *batch, size_t first, size_t end)
{
    size_t i = first + 1;
    while (i < end && kiln_batch_leaves_out(batch, i) == kiln_batch_leaves_out(batch, first))
        i++;
    return i;
}

/* Returns the batch with another taker, which gets no items that are left out. */
static inline struct kiln_batch kiln_batch_taken_by(const struct kiln_batch *batch, kiln_take_results take,
                                                    void *context)
{
    struct kiln_batch own = *batch;
    own.take = take;
    own.take_some = NULL;
    own.context = context;
    return own;
}

/* Returns the part [first, first + count) of the batch, without claims. */
static inline struct kiln_batch kiln_batch_range(const struct kiln_batch *batch, size_t first, size_t count)
{
    struct kiln_batch part = *batch;
    part.first = first;
    part.count = count;
    part.claims = NULL;
    if (batch->positions != NULL)
        part.positions = batch->positions + (first - batch->first);
    if (batch->samples_each != NULL)
        part.samples_each = batch->samples_each + (first - batch->first);
    if (batch->selections != NULL)
        part.selections = batch->selections + (first - batch->first);
    return part;
}

#endif
