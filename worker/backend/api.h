/* How a backend is made: the struct of functions that embree/ and vulkan/ fill in, and those that stand in front of
 * another backend (fallback.c, verify.c). Whoever only uses one needs backend.h, and here and there extended.h. */
#ifndef KILN_WORKER_BACKEND_API_H
#define KILN_WORKER_BACKEND_API_H

#include "worker/backend/backend.h"

struct kiln_batch;
struct kiln_held;
struct kiln_held_fetch;
struct kiln_held_power;
struct kiln_held_step;
struct kiln_pass;
struct kiln_ray_hints;
struct kiln_regression_work;
struct kiln_sphere;

/* Functions that only some backends have; NULL: this one has not. extended.h says what each does, and what is done
 * without it. Backends in front of others have those of the backends behind, and are not asked: none of these is handed
 * on by a function of its own. */
struct kiln_backend_extras {
    int (*clearance)(struct kiln_backend *backend, const struct kiln_sphere *spheres, size_t count, float *clear,
                     struct kiln_error *error);
    int (*ceiling)(struct kiln_backend *backend, const struct kiln_batch *batch, double *seconds, uint64_t *rays,
                   struct kiln_error *error);
    int (*replay)(struct kiln_backend *backend, struct kiln_rows *rows, const uint64_t *const *lights, size_t count,
                  const struct kiln_batch *batch, struct kiln_error *error);
    int (*hold)(struct kiln_backend *backend, const struct kiln_held *begin, bool *held, struct kiln_held_power *powers,
                struct kiln_error *error);
    int (*hold_step)(struct kiln_backend *backend, struct kiln_rows *rows, const struct kiln_batch *batch,
                     const struct kiln_held_step *step, struct kiln_held_power *powers, struct kiln_error *error);
    int (*hold_fetch)(struct kiln_backend *backend, uint32_t light, const struct kiln_held_fetch *to,
                      struct kiln_error *error);
    int (*regress)(struct kiln_backend *backend, const struct kiln_regression_work *work, bool *done,
                   struct kiln_error *error);
};

struct kiln_backend_api {
    const char *name;
    /* Part of the creation without scene, geometry, lights; `create` then goes on with *backend. NULL: there is none */
    int (*begin)(struct kiln_backend **backend, const struct kiln_backend_params *params, struct kiln_error *error);
    int (*create)(struct kiln_backend **backend, const struct kiln_backend_params *params, struct kiln_error *error);
    void (*destroy)(struct kiln_backend **backend);
    int (*devices)(struct kiln_device *list, size_t room, size_t *count, struct kiln_error *error);
    void (*info)(const struct kiln_backend *backend, struct kiln_backend_info *info);
    /* backend->given has a resource anew, and backend->surface is what passes run over from now on. */
    int (*set)(struct kiln_backend *backend, enum kiln_resource_index index, struct kiln_error *error);
    /* Passes that `run` takes with any numbers in samples_each: bit KILN_PASS_INDEX_...; `samples` is the largest then.
     * For other passes over tile runs each number is `samples` or 0, for those over positions samples_each is NULL. */
    uint32_t mixed;
    uint32_t claims; /* likewise passes whose batches `run` claims part by part; it claims others as a whole */
    bool (*takes)(const struct kiln_backend *backend, const struct kiln_pass *pass,
                  const void *parameters); /* NULL: any */
    void (*expect)(struct kiln_backend *backend, const struct kiln_pass *pass,
                   const void *parameters); /* NULL: nothing is to be done */
    /* The arguments of kiln_backend_run, checked; at least one item */
    int (*run)(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
               const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error);
    /* At least one ray; a backend may leave hints alone */
    int (*intersect)(struct kiln_backend *backend, const struct kiln_vec3 *origins, const struct kiln_vec3 *directions,
                     size_t count, const struct kiln_ray_hints *hints, struct kiln_hit *hits, struct kiln_error *error);
    const struct kiln_backend_extras *extras; /* NULL: it has none */
    /* Returns the backend behind one that stands in front of it, as it is now. That one is asked in its place for
     * `takes`, `expect`, `intersect` and the extras. NULL: it stands in front of none. */
    struct kiln_backend *(*inner)(const struct kiln_backend *backend);
    /* After the inner one has failed with `status`: KILN_OK if there is another one now, which is to be asked again;
     * else the status. NULL: there never is. */
    int (*replace)(struct kiln_backend *backend, int status, struct kiln_error *error);
};

extern const struct kiln_backend_api kiln_backend_embree;
extern const struct kiln_backend_api kiln_backend_vulkan;

/* The backend behind all that stand in front of it. */
struct kiln_backend *kiln_backend_innermost(const struct kiln_backend *backend);
/* `replace` of the first that has it. */
int kiln_backend_replace(struct kiln_backend *backend, int status, struct kiln_error *error);

#endif
