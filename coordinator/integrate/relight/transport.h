/* Transport that is kept: what the gather rays of each step have met (worker/pass/rows.h), one file a step in one
 * folder, which all ranks write and any number of ranks can read. A bake that replays it looks rays up where they are
 * kept, and traces the others: a step that was not kept, or that takes other samples because the light is another. So
 * its bits are those of a bake that traces all.
 *
 * Where rays go on from gloss or are tinted, a step has a second file (worker/pass/row_chains.h).
 *
 * Steps of the plain gather pass are kept. What a file's rays hang on is in its key: what the caller says of geometry,
 * layout and settings, and stream, samples and first sample of the step. */
#ifndef KILN_COORDINATOR_INTEGRATE_RELIGHT_TRANSPORT_H
#define KILN_COORDINATOR_INTEGRATE_RELIGHT_TRANSPORT_H

#include "coordinator/integrate/step.h"
#include "worker/backend/backend.h"
#include "worker/pass/row_chains.h"
#include "worker/pass/rows.h"

/* Zero: nothing is kept or replayed. */
struct kiln_transport {
    bool is_on, replays;
    bool has_chains;       /* rays go on from gloss, or are tinted */
    bool of_links;         /* links are kept (link_file.h), and no steps' rays */
    int folder;            /* open, of the files; borrowed */
    const char *directory; /* its path, for messages; borrowed */
    uint64_t key;          /* the same on all ranks: of what all rays hang on */
    uint64_t points;       /* of the surface */
    int rank;
    /* rays of this rank, in this run: kept, or found; traced for want of a row in a bake that replays */
    uint64_t kept, found, traced;
    /* private: the step under way */
    struct kiln_rows rows;
    struct kiln_row_chains chains;
    char path[4352], chains_path[4352];
};

enum { KILN_TRANSPORT_NAME = 64 };

/* Whether the rays of a step are kept, and the names of its files in the folder. */
bool kiln_transport_keeps(const struct kiln_step *step);
void kiln_transport_name(const struct kiln_step *step, char name[KILN_TRANSPORT_NAME]);
void kiln_transport_chains_name(const struct kiln_step *step, char name[KILN_TRANSPORT_NAME]);

/* Bytes that the files of a step will have; of chains, about. */
uint64_t kiln_transport_bytes(uint64_t points, uint32_t samples, bool has_chains);

/* Opens the file of a step, or makes it, and hands it to the backend. A file that is to be read and is not there is no
 * failure: the step is traced. KILN_BAD_INPUT: it is of another bake, or damaged. End with kiln_transport_end, in any
 * case. Not collective. */
int kiln_transport_begin(struct kiln_transport *transport, struct kiln_backend *backend, const struct kiln_step *step,
                         struct kiln_error *error);
/* Takes the file away from the backend; what this rank has written is on disk. Not collective. */
int kiln_transport_end(struct kiln_transport *transport, struct kiln_backend *backend, struct kiln_error *error);

/* Collective, when all ranks have ended the step, in whatever run. Moves the streams of all chains of the step into its
 * file, in the order of points; the files that had them are needed no more (kiln_transport_is_spool). KILN_IO. */
int kiln_transport_pack(struct kiln_transport *transport, MPI_Comm communicator, const struct kiln_step *step,
                        struct kiln_error *error);
/* Whether a file of the folder has streams that are to be moved. */
bool kiln_transport_is_spool(const char *name);

struct kiln_resident_rows;
/* Reads the rows of a step into memory, which has room for the own points', from the folder of a transport that
 * replays; and fills in the rest of `rows`. A file that is not there is no failure: no point has a row. KILN_BAD_INPUT:
 * it is of another bake, or damaged. Not collective. */
int kiln_transport_load(struct kiln_transport *transport, const struct kiln_step *step,
                        struct kiln_resident_rows *memory, struct kiln_rows *rows, struct kiln_error *error);

#endif
