/* Links between surface points and nodes (worker/pass/links.h) during a bake: the tree, and the links of this rank's
 * own tile runs. Links are kept from bounce to bounce. A tile run that moves to another rank, or was done before an
 * interruption, gets its links found again, with the same bits. */
#ifndef KILN_COORDINATOR_INTEGRATE_PATCHES_LINKS_H
#define KILN_COORDINATOR_INTEGRATE_PATCHES_LINKS_H

#include "coordinator/integrate/patches/link_file.h"
#include "coordinator/integrate/patches/link_tree.h"
#include "worker/scene/surface.h"

struct kiln_links;

/* Input from which links are made; borrowed. */
struct kiln_links_source {
    const struct kiln_surface *surface;
    const struct kiln_patch *points; /* as for kiln_link_tree_create, as are rooms and light */
    const uint32_t *rooms;
    const float *light; /* read by kiln_links_create alone */
    struct kiln_link_choice choice;
    double target;                         /* as in struct kiln_links_parameters */
    uint32_t stream;                       /* of the rays that close rows */
    const struct kiln_transport *replayed; /* a bake whose links are reused where it has them; NULL: none */
};

/* KILN_SYSTEM. */
int kiln_links_create(struct kiln_links **links, const struct kiln_links_source *source, struct kiln_error *error);
/* NULL is accepted. */
void kiln_links_destroy(struct kiln_links **links);

/* Estimated memory on each rank, bytes, for `points` points in all and `own` points of the rank; links are not found
 * yet. The second function: of one point's links alone. */
uint64_t kiln_links_bytes_expected(uint64_t points, uint64_t own, double link_error);
double kiln_links_point_bytes(uint64_t points, double link_error);

/* Sets the radiosity of all points; the surface may have been redistributed since the last call. Sets *parameters to
 * those of the pass, valid until the next call. KILN_SYSTEM; KILN_BAD_INPUT: stored links are damaged. */
int kiln_links_update(struct kiln_links *links, uint32_t bounce, kiln_link_of_point light, const void *context,
                      const struct kiln_links_parameters **parameters, struct kiln_error *error);

/* Counts the links of this rank's points, their bytes, and the links reused from another bake. */
void kiln_links_count(const struct kiln_links *links, uint64_t *count, uint64_t *bytes, uint64_t *replayed);

/* Collective, after a step that has found all links. Stores them beside the bake. */
int kiln_links_keep(const struct kiln_links *links, const struct kiln_transport *transport, MPI_Comm communicator,
                    struct kiln_error *error);

#endif
