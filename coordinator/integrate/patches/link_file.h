/* Links that are kept beside a bake (worker/pass/links.h): one file, "links" in the folder of its transport
 * (transport.h). They hang on geometry, layout and settings, and on no light but that by which they were opened; so a
 * bake of the same geometry under other light takes them in the place of tracing.
 *
 * After a header comes a table with 32 bytes for each tile run, in the global order, then their codes in that order.
 * All ranks write, each where its tile runs stand; any number of ranks have the same bytes, and any number can read
 * them. A code has a hash, with a key that is of what the links hang on. The header is written last: a file without it
 * is not finished. */
#ifndef KILN_COORDINATOR_INTEGRATE_PATCHES_LINK_FILE_H
#define KILN_COORDINATOR_INTEGRATE_PATCHES_LINK_FILE_H

#include <mpi.h>

#include "coordinator/integrate/relight/transport.h"
#include "worker/pass/links.h"
#include "worker/scene/surface.h"

#define KILN_LINK_FILE "links"

/* Choice by which links are found, besides geometry. */
struct kiln_link_choice {
    double error;     /* as in struct kiln_links_parameters */
    uint32_t samples; /* of a point, that close its row */
};

/* Collective. Writes the links of all tile runs of the surface; `kept` has one for each own one. Nothing is done where
 * the file is finished already. */
int kiln_link_file_write(const struct kiln_transport *transport, MPI_Comm communicator,
                         const struct kiln_surface *surface, struct kiln_kept_links *const *kept,
                         const struct kiln_link_choice *choice, struct kiln_error *error);

/* Reads the links of the own tile runs that have none. *read: how many of points. A file that is not there, or is of
 * another choice, is no failure: nothing is read. KILN_BAD_INPUT: it is of another bake, or damaged. Not collective. */
int kiln_link_file_read(const struct kiln_transport *transport, const struct kiln_surface *surface,
                        struct kiln_kept_links **kept, const struct kiln_link_choice *choice, uint64_t *read,
                        struct kiln_error *error);

/* Estimates the bytes of a file before links are found. */
uint64_t kiln_link_file_bytes_expected(uint64_t points, double link_error);

#endif
