/* Backend functions for few callers, besides backend.h: what a backend can run on, resources of single features, hints
 * about rays and passes, and what only some backends have. */
#ifndef KILN_WORKER_BACKEND_EXTENDED_H
#define KILN_WORKER_BACKEND_EXTENDED_H

#include "worker/backend/backend.h"
#include "worker/pass/held.h"
#include "worker/pass/regression.h"

struct kiln_sphere;

/* None of these is collective. */

/* Lists what the backend called `name` ("embree" or "vulkan") could run on, at most `room` entries; writes how many
 * there are to `count`. A machine without a driver has none: no error. */
int kiln_backend_devices(const char *name, struct kiln_device *list, size_t room, size_t *count,
                         struct kiln_error *error);
/* Whether the backend called so may compute on a device: "auto" may. */
bool kiln_backend_may_use_device(const char *name);

/* ---- resources ---- */

/* From now on stealable passes run over these tile runs of another rank; none: over the own surface again. A device
 * keeps what it has of its own meanwhile. */
int kiln_backend_set_others(struct kiln_backend *backend, struct kiln_others others, struct kiln_error *error);
/* From now on rays of the gather pass end at the probes' range and ask them (worker/pass/gather.h), at points whose
 * word `near_probes` names one that they see; the surface has these words. Borrowed until the next call, after which
 * `data` may have changed. NULL: rays have no end, as at first. */
int kiln_backend_set_probes(struct kiln_backend *backend, const struct kiln_radiance_probes *probes,
                            struct kiln_error *error);
/* From now on the gather pass keeps what its rays meet in a file, or takes it from there (worker/pass/rows.h). Borrowed
 * until the next call; NULL: neither, as at first. */
void kiln_backend_set_rows(struct kiln_backend *backend, struct kiln_rows *rows);
/* From now on the direct and the gather pass find the light of each group beside that of all (worker/pass/groups.h).
 * Borrowed until the next call; NULL: they do not, as at first. */
void kiln_backend_set_groups(struct kiln_backend *backend, struct kiln_groups *groups);
/* The lights, the sky and the materials' colours of the scene and of `lights` that the backend was created with have
 * changed, in the place where they were: must come before the next pass. Geometry, and what of materials rays meet, are
 * as before. */
int kiln_backend_change_light(struct kiln_backend *backend, struct kiln_error *error);

/* ---- passes ---- */

/* Whether the backend whose info this is claims a batch with claims part by part (kiln_claims), as a device does, which
 * would be idle between batches: such a batch may have all that is left. Others, and all with rows, it claims as a
 * whole. `mixed`: it has samples_each. */
static inline bool kiln_backend_claims(const struct kiln_backend_info *info, const struct kiln_pass *pass, bool mixed)
{
    return ((mixed ? info->claims & info->mixed : info->claims) >> pass->index & 1u) != 0;
}
/* Whether kiln_backend_run takes the pass with these parameters, now: devices leave some to Embree (worker/pass/land.h,
 * weighed.h, reference.h), with KILN_USAGE. */
bool kiln_backend_takes(const struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters);
/* The pass will come with such parameters, over the surface that the backend has: a device begins to make its kernels,
 * beside what runs before it. To be called for what comes for certain, since ending waits for kernels that are being
 * made. Parameters are read only during the call. */
void kiln_backend_expect(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters);

/* ---- rays ---- */

/* Hints about the rays of a call. Zero: none. */
struct kiln_ray_hints {
    /* m, of each ray: nothing counts that is so far off or farther; such a hit may be given, or none. A ray of length 0
     * need not be traced. Borrowed; NULL: everything counts */
    const float *lengths;
    bool
        alike; /* neighbours in the arrays go much the same way, and may be traced together; so they may with lengths */
};
/* kiln_backend_intersect with hints, which a backend may leave alone. */
int kiln_backend_intersect_hinted(struct kiln_backend *backend, const struct kiln_vec3 *origins,
                                  const struct kiln_vec3 *directions, size_t count, const struct kiln_ray_hints *hints,
                                  struct kiln_hit *hits, struct kiln_error *error);

/* ---- what only some backends have ---- */

/* How far off the middles of spheres rays that begin there meet nothing, m, but for rounding: at most the radius and a
 * little more, less rather than too much, and 0 where it is not known, as on devices. */
int kiln_backend_clearance(struct kiln_backend *backend, const struct kiln_sphere *spheres, size_t count, float *clear,
                           struct kiln_error *error);
/* For benches: the gather pass's own rays over a batch, in the same packets and order, traced by the tracer alone; adds
 * the seconds that its calls took and the number of rays. One thread. Nothing is taken. */
int kiln_backend_ceiling(struct kiln_backend *backend, const struct kiln_batch *batch, double *seconds, uint64_t *rays,
                         struct kiln_error *error);
/* Whether kiln_backend_replay is there: the rows that the gather pass fills in memory then are for it alone. */
bool kiln_backend_replays(const struct kiln_backend *backend);
/* The gather pass over a batch's tile runs under `count` lights at once, at most KILN_ROW_LIGHTS, from rows in memory
 * that are all ready (resident_rows.h) and have the batch's samples. `lights`: of each the radiosity of all points,
 * packed. The batch's taker gets `count` results a point, side by side, each with the bits of the gather pass.
 * KILN_NO_DEVICE: the device has failed, and rows in memory are of no use to another backend. */
int kiln_backend_replay(struct kiln_backend *backend, struct kiln_rows *rows, const uint64_t *const *lights,
                        size_t count, const struct kiln_batch *batch, struct kiln_error *error);
/* Whether light may stay here at all (worker/pass/held.h). */
bool kiln_backend_holds(const struct kiln_backend *backend);
/* Light that stays on the device. Brings what it begins with, in the place of what was there, or makes it where it is
 * mixed; *held false: it does not stay here, for there is no room, say. `powers`: KILN_HELD_POWERS of each light; those
 * of lights that are not mixed mean nothing. After a failure what was held is lost; KILN_NO_DEVICE: other calls may go
 * on. */
int kiln_backend_hold(struct kiln_backend *backend, const struct kiln_held *begin, bool *held,
                      struct kiln_held_power *powers, struct kiln_error *error);
/* One step of all lights: the gather from the rows, as kiln_backend_replay, over all tile runs. The batch has no taker.
 * `powers`: KILN_HELD_POWERS of each light. */
int kiln_backend_hold_step(struct kiln_backend *backend, struct kiln_rows *rows, const struct kiln_batch *batch,
                           const struct kiln_held_step *step, struct kiln_held_power *powers, struct kiln_error *error);
/* After a final step: the light of each point, and its errors. */
int kiln_backend_hold_fetch(struct kiln_backend *backend, uint32_t light, const struct kiln_held_fetch *to,
                            struct kiln_error *error);
/* Surface regression (worker/pass/regression.h). *done false: the caller has to do it, for this backend has no device,
 * or a device too little room. Results that were taken are of no use then, nor after a failure. */
int kiln_backend_regress(struct kiln_backend *backend, const struct kiln_regression_work *work, bool *done,
                         struct kiln_error *error);

#endif
