/* Light paths to the probes of an irradiance volume. They bring the light of lamps by way of mirrors, smooth glass and
 * sharp gloss, which gather rays of probes find badly or not at all (worker/pass/spheres.h divides the work).
 *
 * With --caustics land, merge or vcm the volume has a second stage. Light paths are traced as in the landing step
 * (integrate/land/land.h): in as many iterations (as many as its first round, if later rounds have more), aimed at
 * where earlier paths have brought light, each rank an equal part. Fewer paths are traced if they are enough for the
 * probes. Every probe has a sphere around the place where its light is gathered; its radius is half the smallest
 * spacing. The light is a mean over this sphere, which is its bias. A probe inside geometry that found no place outside
 * has no sphere, and is filled from others.
 *
 * Sums are whole numbers, the same for any ranks and threads. Spheres are processed in chunks of KILN_PROBE_PATHS_CHUNK
 * to bound memory, and the paths are traced again for each chunk. After each chunk its light is added to the probes,
 * which are marked complete; a checkpoint stores both. An interrupted chunk is traced again: the same bits. */
#ifndef KILN_COORDINATOR_BAKE_VOLUME_PROBE_PATHS_H
#define KILN_COORDINATOR_BAKE_VOLUME_PROBE_PATHS_H

#include "coordinator/field/result.h"
#include "coordinator/integrate/settings.h"
#include "coordinator/run/control.h"
#include "coordinator/run/progress.h"

enum { KILN_PROBE_PATHS_CHUNK = 1 << 18 };

/* Progress of a probe. */
enum kiln_probe_done { KILN_PROBE_TO_DO = 0, KILN_PROBE_GATHERED = 1, KILN_PROBE_COMPLETE = 2 };

struct kiln_probe_paths_params {
    MPI_Comm communicator;
    struct kiln_backend *backend; /* has its surface; paths that the device cannot trace are traced by the host */
    const struct kiln_scene *scene;
    const struct kiln_integrate_settings *settings;
    uint32_t leaves;  /* kiln_probe_paths_leaves */
    uint32_t samples; /* rays of a probe */
    struct kiln_progress *progress;
    struct kiln_control *control;
    int (*save)(void *context, bool stop, struct kiln_error *error); /* as kiln_volume_save, of this volume */
    void *context;
};

/* Sets `leaves` to the kinds of lamps (KILN_LEAVES_... of shaders/shared/streams.h) whose light by way of sharp lobes
 * reaches probes through light paths. The gather rays of probes, which are not biased, find other lamps. 0: no light
 * paths. Points, spots, directional lights and images of the sky are always among the kinds. Emitting surfaces are, if
 * the `samples` rays of a probe would hit them so rarely that the error of their light is above an eighth of it. The
 * estimate uses the emitting areas and fluxes of objects and the scene's diagonal. The same on all ranks; not
 * collective. KILN_SYSTEM. */
int kiln_probe_paths_leaves(const struct kiln_integrate_settings *settings, const struct kiln_lights *lights,
                            uint32_t samples, uint32_t *leaves, struct kiln_error *error);

/* Announces the light paths to the backend (kiln_backend_expect), if `leaves` is not 0. Not collective; KILN_SYSTEM. */
int kiln_probe_paths_expect(const struct kiln_integrate_settings *settings, struct kiln_backend *backend,
                            uint32_t leaves, struct kiln_error *error);

/* Number of paths in an iteration with `aims` aims. If the user gives the number, it is that of the landing step
 * (kiln_landing_photons). Else it is at most that and is limited by the `samples` rays of a probe: all iterations of
 * all parts together send that many paths through a probe's part of a face of the grid. Light that goes from face to
 * face crosses each sphere three times for four rays (the sphere covers a quarter of pi of that part). At least four an
 * aim. */
uint64_t kiln_probe_paths_photons(const struct kiln_integrate_settings *settings, size_t aims, const uint64_t size[3],
                                  uint32_t samples);

/* Collective. Adds the light of paths to the own `probes`, all of which are gathered, except those that are complete;
 * marks them complete in `done`. Adds the number of rays to *rays, and counts paths in the volume. KILN_SYSTEM;
 * KILN_STOPPED if something asked to stop. */
int kiln_probe_paths_add(const struct kiln_probe_paths_params *params, struct kiln_volume_result *volume,
                         struct kiln_probe_result *probes, uint8_t *done, uint64_t *rays, struct kiln_error *error);

/* Bytes that a rank needs for the paths to so many probes, without a BVH; `device`: a device traces the paths. */
uint64_t kiln_probe_paths_bytes(uint64_t probes, uint32_t ranks, bool device);

/* Cost of the paths, as a few of them have it: for kiln plan. */
struct kiln_probe_paths_cost {
    double seconds; /* of one rank that traces all of them */
    uint64_t bytes; /* of each rank */
};
/* Traces some paths, as the first iteration would, through a chunk of spheres about the probes of the grid; of a
 * surface with so many points, on a process with so many threads. All zeros where there are none. `params`: of a
 * backend, a scene, settings and rays of a probe. Not collective. KILN_SYSTEM. */
int kiln_probe_paths_measure(struct kiln_probe_paths_cost *cost, const struct kiln_probe_paths_params *params,
                             const struct kiln_volume_result *grid, uint64_t points, uint32_t threads, uint32_t ranks,
                             struct kiln_error *error);

/* Makes spheres around unmoved probes, as many as a chunk has, with room for their sums: kiln plan tries paths with
 * them. `host`: kiln_landing_host, or the backend if there is no such host. Release with kiln_probe_spheres_release, in
 * any case. KILN_SYSTEM. */
struct kiln_probe_spheres;
struct kiln_aims;
int kiln_probe_spheres_try(struct kiln_probe_spheres *spheres, struct kiln_backend *host,
                           const struct kiln_volume_result *grid, const struct kiln_scene *scene,
                           const struct kiln_aims *aims, uint32_t leaves, struct kiln_error *error);
void kiln_probe_spheres_release(struct kiln_probe_spheres *spheres);

#endif
