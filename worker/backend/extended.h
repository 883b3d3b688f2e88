/* Backend functions that few callers need, in addition to backend.h: list of devices, resources of single features,
 * hints about rays and passes, and optional functions. */
#ifndef KILN_WORKER_BACKEND_EXTENDED_H
#define KILN_WORKER_BACKEND_EXTENDED_H

#include "worker/backend/backend.h"
#include "worker/pass/held.h"
#include "worker/pass/regression.h"

struct kiln_sphere;

/* None of these functions is collective. */

/* Lists the devices on which the backend called `name` ("embree" or "vulkan") could run, at most `room` entries; sets
 * `count` to their total number. A machine without a driver has none, which is no error. */
int kiln_backend_devices(const char *name, struct kiln_device *list, size_t room, size_t *count,
                         struct kiln_error *error);
/* Whether the backend called `name` may compute on a device: "auto" may. */
bool kiln_backend_may_use_device(const char *name);

/* ---- resources ---- */

/* Makes stealable passes run over these tile runs of another rank from now on; none: over this rank's surface again.
 * Meanwhile a device keeps this rank's data. */
int kiln_backend_set_others(struct kiln_backend *backend, struct kiln_others others, struct kiln_error *error);
/* Makes rays of the gather pass end at the probes' range and look up a probe (worker/pass/gather.h), at points that see
 * a probe according to their word in surface->near_probes. Borrowed until the next call, after which `data` may have
 * changed. NULL, as at first: rays have unlimited length. */
int kiln_backend_set_probes(struct kiln_backend *backend, const struct kiln_radiance_probes *probes,
                            struct kiln_error *error);
/* Makes the gather pass write its rays' hits to a file, or read them from it instead of tracing (worker/pass/rows.h).
 * Borrowed until the next call; NULL, as at first: neither. */
void kiln_backend_set_rows(struct kiln_backend *backend, struct kiln_rows *rows);
/* Makes the direct and the gather pass compute the light of each group in addition to the whole light
 * (worker/pass/groups.h). Borrowed until the next call; NULL, as at first: they do not. */
void kiln_backend_set_groups(struct kiln_backend *backend, struct kiln_groups *groups);
/* Notifies that the lights, the sky and the materials' colours have been changed in place, in the scene and in the
 * `lights` that the backend was created with. Must come before the next pass. Geometry, and material data that decide
 * what rays hit, are unchanged. */
int kiln_backend_change_light(struct kiln_backend *backend, struct kiln_error *error);

/* ---- passes ---- */

/* Whether the backend with this info claims a batch with claims part by part (kiln_claims). Devices do, since they
 * would be idle between batches: such a batch may contain all remaining work. Other batches, and all with rows, are
 * claimed as a whole. `mixed`: the batch has samples_each. */
static inline bool kiln_backend_claims(const struct kiln_backend_info *info, const struct kiln_pass *pass, bool mixed)
{
    return ((mixed ? info->claims & info->mixed : info->claims) >> pass->index & 1u) != 0;
}
/* Whether kiln_backend_run now accepts the pass with these parameters. Devices leave some to Embree
 * (worker/pass/land.h, weighed.h, reference.h), and return KILN_USAGE. */
bool kiln_backend_takes(const struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters);
/* Announces a pass with such parameters over the backend's surface: a device begins to make its kernels in the
 * background. Call it only for passes that will surely run, since destruction waits for kernels in the making.
 * Parameters are read only during the call. */
void kiln_backend_expect(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters);

/* ---- rays ---- */

/* Hints about the rays of a call. Zero: none. */
struct kiln_ray_hints {
    /* m: length of each ray. Hits at that distance or farther do not count: they may be returned or not. A ray of
     * length 0 need not be traced. Borrowed; NULL: unlimited */
    const float *lengths;
    bool
        alike; /* neighbours in the arrays have similar directions, and may be traced together; so they may with lengths
                */
};
/* As kiln_backend_intersect, with hints that a backend may ignore. */
int kiln_backend_intersect_hinted(struct kiln_backend *backend, const struct kiln_vec3 *origins,
                                  const struct kiln_vec3 *directions, size_t count, const struct kiln_ray_hints *hints,
                                  struct kiln_hit *hits, struct kiln_error *error);

/* ---- optional functions of some backends ---- */

/* Finds for each sphere the distance, m, from its middle within which rays that begin there hit nothing, but for
 * rounding. It is at most a little more than the radius, rather too small than too large, and 0 where it is not known,
 * as on devices. */
int kiln_backend_clearance(struct kiln_backend *backend, const struct kiln_sphere *spheres, size_t count, float *clear,
                           struct kiln_error *error);
/* For benches: traces the gather pass's rays over a batch, in the same packets and order, by the tracer alone, on one
 * thread. Adds the seconds of its calls and the number of rays. The taker is not called. */
int kiln_backend_ceiling(struct kiln_backend *backend, const struct kiln_batch *batch, double *seconds, uint64_t *rays,
                         struct kiln_error *error);
/* Whether the backend has kiln_backend_replay: rows that the gather pass fills in memory then serve only that. */
bool kiln_backend_replays(const struct kiln_backend *backend);
/* Runs the gather pass over a batch's tile runs under `count` lights at once, at most KILN_ROW_LIGHTS, from rows in
 * memory that are all ready (resident_rows.h) and have the batch's samples. `lights`: packed radiosity of all points
 * under each light. The batch's taker gets `count` results a point, side by side, each with the bits of the gather
 * pass. KILN_NO_DEVICE: the device has failed, and another backend cannot use rows in memory. */
int kiln_backend_replay(struct kiln_backend *backend, struct kiln_rows *rows, const uint64_t *const *lights,
                        size_t count, const struct kiln_batch *batch, struct kiln_error *error);
/* Whether the backend can hold light on a device (worker/pass/held.h). */
bool kiln_backend_holds(const struct kiln_backend *backend);
/* Begins to hold light on the device: uploads its initial values, or computes them for mixed lights, replacing any held
 * before. *held false: the light is not held, for example for lack of memory. `powers`: KILN_HELD_POWERS of each light;
 * undefined for lights that are not mixed. After a failure held light is lost; KILN_NO_DEVICE: other calls may go on.
 */
int kiln_backend_hold(struct kiln_backend *backend, const struct kiln_held *begin, bool *held,
                      struct kiln_held_power *powers, struct kiln_error *error);
/* One step of all lights: the gather from the rows, as kiln_backend_replay, over all tile runs. The batch has no taker.
 * `powers`: KILN_HELD_POWERS of each light. */
int kiln_backend_hold_step(struct kiln_backend *backend, struct kiln_rows *rows, const struct kiln_batch *batch,
                           const struct kiln_held_step *step, struct kiln_held_power *powers, struct kiln_error *error);
/* Fetches the light of each point, and its errors, after a final step. */
int kiln_backend_hold_fetch(struct kiln_backend *backend, uint32_t light, const struct kiln_held_fetch *to,
                            struct kiln_error *error);
/* Runs surface regression (worker/pass/regression.h). *done false: the caller has to do it, as this backend has no
 * device, or the device too little memory. Results taken until then, or until a failure, are invalid. */
int kiln_backend_regress(struct kiln_backend *backend, const struct kiln_regression_work *work, bool *done,
                         struct kiln_error *error);

#endif
