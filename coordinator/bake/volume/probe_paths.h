/* Light that paths bring to the probes of an irradiance volume: light of lamps by mirrors, smooth glass and sharp
 * gloss, which gather rays of probes find badly or not at all (worker/pass/spheres.h says who finds what).
 *
 * With --caustics land, merge or vcm the volume has a second stage. Paths go out as in the step that lands
 * (integrate/land/land.h): as many iterations (of the first round alone, where later ones have more), aimed by what
 * earlier ones have brought, each rank an equal part. There are fewer paths where that is enough for the probes. Every
 * probe has a sphere of half the smallest spacing about the place where its light is gathered, so that light of this
 * kind is a mean over the sphere: that is its bias. A probe inside geometry that found no place outside has none, and
 * is filled from others.
 *
 * Sums are whole numbers, the same for any ranks and threads. Spheres are taken KILN_PROBE_PATHS_CHUNK at a time, so
 * that memory stays bounded, and the paths are traced again for each such chunk. After each chunk its light is added to
 * the probes and they are marked; a checkpoint has them so, and what is under way then is traced again: the same bits.
 */
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
    struct kiln_backend *backend; /* has its surface; what a device does not take of the paths the host traces */
    const struct kiln_scene *scene;
    const struct kiln_integrate_settings *settings;
    uint32_t leaves;  /* kiln_probe_paths_leaves */
    uint32_t samples; /* rays of a probe */
    struct kiln_progress *progress;
    struct kiln_control *control;
    int (*save)(void *context, bool stop, struct kiln_error *error); /* as kiln_volume_save, of this volume */
    void *context;
};

/* Sets `leaves` to the kinds of lamps (KILN_LEAVES_... of shaders/shared/streams.h) whose light by sharp lobes comes to
 * probes by light paths. Other lamps are left to the rays of probes, which are not biased. 0: there are no light paths.
 * Points, spots, directional lights and images of the sky are always among the kinds. Surfaces that emit are, if the
 * `samples` rays of a probe would meet them so rarely that the error of their light is above an eighth of it. That is
 * estimated from the emitting areas and fluxes of objects and the scene's diagonal. The same on all ranks; not
 * collective. KILN_SYSTEM. */
int kiln_probe_paths_leaves(const struct kiln_integrate_settings *settings, const struct kiln_lights *lights,
                            uint32_t samples, uint32_t *leaves, struct kiln_error *error);

/* Tells the backend that the paths will come (kiln_backend_expect), if `leaves` is not 0. Not collective; KILN_SYSTEM.
 */
int kiln_probe_paths_expect(const struct kiln_integrate_settings *settings, struct kiln_backend *backend,
                            uint32_t leaves, struct kiln_error *error);

/* Paths of an iteration, of so many aims. As many as land in one (kiln_landing_photons) where the user says how many,
 * else so many at most that all iterations of all parts send as many through a probe's part of a face of the grid as
 * the probe has rays, `samples`: light that goes from face to face crosses each sphere three times for four rays (it
 * covers a quarter of pi of that part). At least four an aim. */
uint64_t kiln_probe_paths_photons(const struct kiln_integrate_settings *settings, size_t aims, const uint64_t size[3],
                                  uint32_t samples);

/* Collective. Adds the light to own `probes`, all of which are gathered, and not yet to those that are complete; marks
 * them in `done`. Adds the number of rays to *rays, and counts paths in the volume. KILN_SYSTEM; KILN_STOPPED if
 * something asked to stop. */
int kiln_probe_paths_add(const struct kiln_probe_paths_params *params, struct kiln_volume_result *volume,
                         struct kiln_probe_result *probes, uint8_t *done, uint64_t *rays, struct kiln_error *error);

/* Bytes that a rank needs for the paths to so many probes, but for a BVH; `device`: one traces them. */
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

/* Spheres about unmoved probes, as many as a chunk has, with room for their sums, to try paths with: for kiln plan.
 * `host`: kiln_landing_host, or the backend where there is none. Release with kiln_probe_spheres_release, in any case.
 * KILN_SYSTEM. */
struct kiln_probe_spheres;
struct kiln_aims;
int kiln_probe_spheres_try(struct kiln_probe_spheres *spheres, struct kiln_backend *host,
                           const struct kiln_volume_result *grid, const struct kiln_scene *scene,
                           const struct kiln_aims *aims, uint32_t leaves, struct kiln_error *error);
void kiln_probe_spheres_release(struct kiln_probe_spheres *spheres);

#endif
