/* Patches from which a bake by radiosity (radiosity/radiosity.h) gathers: those of all surface points, on every rank,
 * and the nodes that a step makes of them (worker/pass/patches.h).
 *
 * A node is a single point that sends light, or a square of texels of one lightmap (Kahl, "RTX Radiosity", 2023,
 * sections 5.1.1 to 5.1.3). Four squares merge into one, from single texels up, if none of them holds several nodes,
 * they are adjacent, and their orientations differ by at most 25 degrees: so a node spans two charts only if these
 * continue each other. A node's area is that of its existing texels.
 *
 *   --undersample stride   a window of W x W texels has the radiosity and the place of its first texel
 *                 random   of one of them by chance, another one in each step, in proportion to their areas
 *                 mipmap   their mean radiosity, at their middle; rays go to the place of a texel by it
 *   --subdivide X:N        likewise the mean, where max |B - mean| / 2 + max |n - mean| / 2 level is below X level,
 * over all four and the largest channel; level is the mean radiosity of all points in the step. N x N texels at most
 * are one node.
 *
 * With --patches links the links pass (worker/pass/links.h) replaces the patches pass, and gathers from the tree of
 * links.h. With --gather other than pairs there are no nodes: rays follow sets of directions, or go to bright patches
 * (directions.h).
 *
 * A rank keeps a patch and room for a node for each surface point of the scene: kiln_patches_bytes. */
#ifndef KILN_COORDINATOR_INTEGRATE_PATCHES_PATCHES_H
#define KILN_COORDINATOR_INTEGRATE_PATCHES_PATCHES_H

#include <mpi.h>

#include "coordinator/field/rank_data.h"
#include "coordinator/integrate/settings.h"
#include "coordinator/integrate/step.h"
#include "coordinator/integrate/relight/transport.h"
#include "worker/backend/backend.h"
#include "worker/pass/patches.h"
#include "worker/pass/visibility_cache.h"

struct kiln_patches;

/* Input from which patches are made. All borrowed; the surface may be distributed anew meanwhile. */
struct kiln_patches_source {
    MPI_Comm communicator; /* of all ranks, which have the surface's points among them */
    int ranks;
    const struct kiln_surface *surface;
    struct kiln_backend *backend;                   /* has that surface */
    const struct kiln_integrate_settings *settings; /* with patches */
    float *const *direct;                           /* direct light of own points, W/m2, 3 each; NULL: none yet */
    /* own points' data, with fields for nodes if nodes are stored; NULL: nodes are not stored */
    const struct kiln_rank_data *const *own;
    const struct kiln_transport *replayed; /* a bake whose links are reused where it has them; NULL: none */
    bool keeps_visibility;                 /* visibility is kept from step to step, as the settings say */
};

/* Not collective. KILN_SYSTEM. */
int kiln_patches_create(struct kiln_patches **patches, const struct kiln_patches_source *source,
                        struct kiln_error *error);
/* NULL is accepted. */
void kiln_patches_destroy(struct kiln_patches **patches);

/* Upper bound of the memory, bytes, for patches on a rank with `own` of `points` surface points. `device`: a device
 * computes. The second function: memory on the device, for a grid and for visibility. */
uint64_t kiln_patches_bytes(const struct kiln_patch_settings *settings, uint64_t own, uint64_t points, bool device);
uint64_t kiln_patches_device_bytes(const struct kiln_patch_settings *settings, uint64_t own, uint64_t points);
/* Statistics of the visibility cached on this rank; all 0: nothing is cached. */
struct kiln_visibility_counts kiln_patches_visibility(const struct kiln_patches *patches);
/* Counts the links kept on this rank, and their bytes; 0: none. */
void kiln_patches_links(const struct kiln_patches *patches, uint64_t *count, uint64_t *bytes);

/* Collective, after a step of the links pass. Stores the links of bounces beside the bake and counts them; or counts
 * the links reused from another bake and those found because it had none. */
int kiln_patches_keep(const struct kiln_patches *patches, struct kiln_transport *transport, struct kiln_error *error);

/* Collective. Prepares a step from the packed radiosity of all points: the nodes of the patches pass, or the data of
 * the links or directions pass. *parameters points to those of the pass, valid until the next call or the end of the
 * patches. The first call computes the shapes of all points, and warns if their pairs will take very long. The result
 * is the same for any number of ranks. */
int kiln_patches_update(struct kiln_patches *patches, const uint64_t *radiosity, const struct kiln_step *step,
                        const void **parameters, struct kiln_error *error);

#endif
