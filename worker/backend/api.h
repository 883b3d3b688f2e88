/* Interface that a backend implements: a struct of functions, which embree/ and vulkan/ fill in, and so do wrappers of
 * another backend (fallback.c, verify.c). Mere users of a backend need backend.h, and occasionally extended.h. */
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

/* Optional functions of a backend; NULL: not implemented. extended.h describes each, and what is done without it.
 * Wrappers do not implement them: the caller goes to the wrapped backend instead. */
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
    /* First part of creation, which needs no scene, geometry or lights; `create` then continues with *backend. NULL:
     * none */
    int (*begin)(struct kiln_backend **backend, const struct kiln_backend_params *params, struct kiln_error *error);
    int (*create)(struct kiln_backend **backend, const struct kiln_backend_params *params, struct kiln_error *error);
    void (*destroy)(struct kiln_backend **backend);
    int (*devices)(struct kiln_device *list, size_t room, size_t *count, struct kiln_error *error);
    void (*info)(const struct kiln_backend *backend, struct kiln_backend_info *info);
    /* Notifies of a new resource in backend->given. Passes from now on run over backend->surface. */
    int (*set)(struct kiln_backend *backend, enum kiln_resource_index index, struct kiln_error *error);
    /* Passes (bits KILN_PASS_INDEX_...) for which `run` accepts any numbers in samples_each, with `samples` as the
     * largest. For other passes over tile runs each number is `samples` or 0; for passes over positions samples_each is
     * NULL. */
    uint32_t mixed;
    uint32_t claims; /* passes (bits) whose batches `run` claims part by part; it claims others as a whole */
    bool (*takes)(const struct kiln_backend *backend, const struct kiln_pass *pass,
                  const void *parameters); /* NULL: it takes every pass */
    void (*expect)(struct kiln_backend *backend, const struct kiln_pass *pass,
                   const void *parameters); /* NULL: no preparation needed */
    /* Runs a pass with the arguments of kiln_backend_run, already checked; at least one item */
    int (*run)(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
               const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error);
    /* Traces at least one ray; a backend may ignore the hints */
    int (*intersect)(struct kiln_backend *backend, const struct kiln_vec3 *origins, const struct kiln_vec3 *directions,
                     size_t count, const struct kiln_ray_hints *hints, struct kiln_hit *hits, struct kiln_error *error);
    const struct kiln_backend_extras *extras; /* NULL: it has none */
    /* Returns the backend that a wrapper currently wraps. Callers ask that one for `takes`, `expect`, `intersect` and
     * the extras. NULL: the backend is no wrapper. */
    struct kiln_backend *(*inner)(const struct kiln_backend *backend);
    /* Replaces the inner backend after it has failed with `status`: returns KILN_OK if there is another one, which is
     * then asked again; else the status. NULL: never replaces. */
    int (*replace)(struct kiln_backend *backend, int status, struct kiln_error *error);
};

extern const struct kiln_backend_api kiln_backend_embree;
extern const struct kiln_backend_api kiln_backend_vulkan;

/* Returns the backend behind all wrappers. */
struct kiln_backend *kiln_backend_innermost(const struct kiln_backend *backend);
/* Calls `replace` of the first wrapper that has it. */
int kiln_backend_replace(struct kiln_backend *backend, int status, struct kiln_error *error);

#endif
