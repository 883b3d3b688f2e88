/* Patches that a bake by radiosity (radiosity/radiosity.h) gathers from: those of all surface points, on every rank,
 * and the nodes of a step made of them (worker/pass/patches.h).
 *
 * Each point that sends light is a node; or nodes stand for squares of texels of one lightmap (Kahl, "RTX Radiosity",
 * 2023, sections 5.1.1 to 5.1.3). Four squares are joined to one, from the single texels up, if none of them holds
 * several nodes, and if they lie beside each other and look one way within 25 degrees: so a node never has texels of
 * two charts, but of such as go on into each other. A node's area is that of its texels that are there.
 *
 *   --undersample stride   a window of W x W texels has the radiosity and the place of its first texel
 *                 random   of one of them by chance, another one in each step, in proportion to their areas
 *                 mipmap   their mean radiosity, at their middle; rays go to the place of a texel by it
 *   --subdivide X:N        likewise the mean, where max |B - mean| / 2 + max |n - mean| / 2 level is below X level,
 * over all four and the largest channel; level is the mean radiosity of all points in the step. N x N texels at most
 * are one node.
 *
 * With --patches links the links pass (worker/pass/links.h) is asked in the place of the patches pass: what it gathers
 * from is links.h's. With --gather other than pairs there are no nodes: rays are sent by sets of directions, or to
 * bright patches (directions.h).
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
    float *const *direct; /* where direct light of own points stands, W/m2, 3 each; NULL: there is none yet */
    /* own points' data, with room for their nodes where these are kept; NULL: they are not */
    const struct kiln_rank_data *const *own;
    const struct kiln_transport *replayed; /* whose links are taken where it has them; NULL: there is none */
    bool keeps_visibility;                 /* as the settings say: from step to step, for the later ones */
};

/* Not collective. KILN_SYSTEM. */
int kiln_patches_create(struct kiln_patches **patches, const struct kiln_patches_source *source,
                        struct kiln_error *error);
/* NULL is accepted. */
void kiln_patches_destroy(struct kiln_patches **patches);

/* Most bytes of memory for patches, on a rank with `own` points, of so many surface points in all. `device`: one
 * computes; the second is what is on that of a grid and of what patches see. */
uint64_t kiln_patches_bytes(const struct kiln_patch_settings *settings, uint64_t own, uint64_t points, bool device);
uint64_t kiln_patches_device_bytes(const struct kiln_patch_settings *settings, uint64_t own, uint64_t points);
/* Counts of the visibility that this rank has kept; all 0: it keeps none. */
struct kiln_visibility_counts kiln_patches_visibility(const struct kiln_patches *patches);
/* The links of points that this rank has kept, and the bytes that they take; 0: none. */
void kiln_patches_links(const struct kiln_patches *patches, uint64_t *count, uint64_t *bytes);

/* Collective, after a step of the links pass: keeps its links beside the bake, where they are those of bounces, and
 * counts them; or counts those that another bake has kept, and those that were found for want of them. */
int kiln_patches_keep(const struct kiln_patches *patches, struct kiln_transport *transport, struct kiln_error *error);

/* Collective. Makes the nodes of a step of the patches pass, or what a step of the links pass or the directions pass
 * needs, of the packed radiosity of all points, and points *parameters to what the step is run with, which stands until
 * the next call or the end of the patches. The first call finds the shapes of all points, and warns where their pairs
 * will take very long. Any ranks get the same. */
int kiln_patches_update(struct kiln_patches *patches, const uint64_t *radiosity, const struct kiln_step *step,
                        const void **parameters, struct kiln_error *error);

#endif
