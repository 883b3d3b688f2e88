/* Kept transport: the hits of each step's gather rays (worker/pass/rows.h), one file per step in one folder, written by
 * all ranks and readable by any number of ranks. A bake that replays it looks up the rays that are kept and traces the
 * others: those of a step that was not kept, or that takes other samples under other light. So its bits are those of a
 * bake that traces everything.
 *
 * If rays continue from gloss or are tinted, a step has a second file (worker/pass/row_chains.h).
 *
 * Only steps of the plain gather pass are kept. A file's key identifies the data on which its rays depend: the caller's
 * key of geometry, layout and settings, and the step's stream, samples and first sample. */
#ifndef KILN_COORDINATOR_INTEGRATE_RELIGHT_TRANSPORT_H
#define KILN_COORDINATOR_INTEGRATE_RELIGHT_TRANSPORT_H

#include "coordinator/integrate/step.h"
#include "worker/backend/backend.h"
#include "worker/pass/row_chains.h"
#include "worker/pass/rows.h"

/* Zero: nothing is kept or replayed. */
struct kiln_transport {
    bool is_on, replays;
    bool has_chains;       /* rays continue from gloss, or are tinted */
    bool of_links;         /* only links are kept (link_file.h), no rays of steps */
    int folder;            /* open, of the files; borrowed */
    const char *directory; /* its path, for messages; borrowed */
    uint64_t key;          /* the same on all ranks: identifies the data on which all rays depend */
    uint64_t points;       /* of the surface */
    int rank;
    /* ray counts of this rank in this run: kept; found in files; traced, in a replay, because no row was kept */
    uint64_t kept, found, traced;
    /* private: the step under way */
    struct kiln_rows rows;
    struct kiln_row_chains chains;
    char path[4352], chains_path[4352];
};

enum { KILN_TRANSPORT_NAME = 64 };

/* kiln_transport_keeps: whether the rays of a step are kept. The others return the names of its files in the folder. */
bool kiln_transport_keeps(const struct kiln_step *step);
void kiln_transport_name(const struct kiln_step *step, char name[KILN_TRANSPORT_NAME]);
void kiln_transport_chains_name(const struct kiln_step *step, char name[KILN_TRANSPORT_NAME]);

/* Bytes that the files of a step will have; an estimate for chains. */
uint64_t kiln_transport_bytes(uint64_t points, uint32_t samples, bool has_chains);

/* Opens or creates the file of a step and passes it to the backend. A missing file is no failure in a replay: the step
 * is traced. KILN_BAD_INPUT: the file is of another bake, or damaged. End with kiln_transport_end, in any case. Not
 * collective. */
int kiln_transport_begin(struct kiln_transport *transport, struct kiln_backend *backend, const struct kiln_step *step,
                         struct kiln_error *error);
/* Removes the file from the backend and writes this rank's data to disk. Not collective. */
int kiln_transport_end(struct kiln_transport *transport, struct kiln_backend *backend, struct kiln_error *error);

/* Collective, after all ranks have ended the step, in any run. Moves the streams of all chains of the step into its
 * file, in the order of points; the temporary files of streams are needed no more (kiln_transport_is_spool).
 * KILN_IO. */
int kiln_transport_pack(struct kiln_transport *transport, MPI_Comm communicator, const struct kiln_step *step,
                        struct kiln_error *error);
/* Whether `name` is a temporary file of streams that are yet to be moved. */
bool kiln_transport_is_spool(const char *name);

struct kiln_resident_rows;
/* Reads the rows of a step from the folder of a replayed transport into memory, which has room for the own points, and
 * fills in the rest of `rows`. A missing file is no failure: no point has a row. KILN_BAD_INPUT: the file is of another
 * bake, or damaged. Not collective. */
int kiln_transport_load(struct kiln_transport *transport, const struct kiln_step *step,
                        struct kiln_resident_rows *memory, struct kiln_rows *rows, struct kiln_error *error);

#endif
