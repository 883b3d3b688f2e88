/* Links stored beside a bake (worker/pass/links.h): one file, "links" in the folder of its transport (transport.h).
 * They depend on geometry, layout and settings; on light only by the one that refined them. So a bake of the same
 * geometry under other light reuses them instead of tracing.
 *
 * The file is a header, then a table with 32 bytes for each tile run in the global order, then the codes of the links
 * in that order. All ranks write, each at the places of its tile runs; the bytes do not depend on the number of ranks,
 * and any number of ranks can read them. Each code has a hash, keyed by all data on which links depend. The header is
 * written last: a file without it is incomplete. */
#ifndef KILN_COORDINATOR_INTEGRATE_PATCHES_LINK_FILE_H
#define KILN_COORDINATOR_INTEGRATE_PATCHES_LINK_FILE_H

#include <mpi.h>

#include "coordinator/integrate/relight/transport.h"
#include "worker/pass/links.h"
#include "worker/scene/surface.h"

#define KILN_LINK_FILE "links"

/* Parameters, besides geometry, that determine the links. */
struct kiln_link_choice {
    double error;     /* as in struct kiln_links_parameters */
    uint32_t samples; /* of a point: rays that close its row */
};

/* Collective. Writes the links of all tile runs; `kept` has one element for each own tile run. Does nothing if the file
 * is complete. */
int kiln_link_file_write(const struct kiln_transport *transport, MPI_Comm communicator,
                         const struct kiln_surface *surface, struct kiln_kept_links *const *kept,
                         const struct kiln_link_choice *choice, struct kiln_error *error);

/* Reads links for the own tile runs that have none. *read: number of points read. A missing file, or one of another
 * choice, is no failure: nothing is read. KILN_BAD_INPUT: the file is of another bake, or damaged. Not collective. */
int kiln_link_file_read(const struct kiln_transport *transport, const struct kiln_surface *surface,
                        struct kiln_kept_links **kept, const struct kiln_link_choice *choice, uint64_t *read,
                        struct kiln_error *error);

/* Estimates the bytes of a file before links are found. */
uint64_t kiln_link_file_bytes_expected(uint64_t points, double link_error);

#endif
