/* Exchange (an all-to-all): each rank sends elements to each rank, as many as only the sender knows at first.
 *
 *     KILN_TRY(kiln_exchange_create(&e, communicator, limit, "the landings of light paths", error));
 *     e.sent[r]: how many elements go to rank r
 *     kiln_exchange_lay_out(&e): e.sent_at[r], the place of the first of them
 *     KILN_TRY(kiln_exchange_count(&e, pack(..., error), error)): e.got[r], e.got_at[r], e.got_all
 *     KILN_TRY(kiln_exchange_send(&e, room_for(e.got_all, ..., error), size, out, in, error));
 *     end: kiln_exchange_release(&e);
 *
 * Counts and places are elements, of 64 bits. A message has at most `limit` of them, so a count may be larger than what
 * an int holds, and what two ranks exchange may take several messages. What a rank sends to itself is copied, by
 * several threads where it is much.
 *
 * Errors: whatever may fail on one rank only goes in as `status`, with its message in `error`. All ranks agree on it
 * (agree.h) before any of them sends, and all return the same status. So no rank waits for one that has failed.
 *
 * The counts may be used any number of times, with elements of other sizes, and the other way round
 * (kiln_exchange_turn). Of exchanges that are under way together on one communicator, all ranks begin the same one
 * first. */
#ifndef KILN_COORDINATOR_MPI_EXCHANGE_H
#define KILN_COORDINATOR_MPI_EXCHANGE_H

#include <mpi.h>
#include <stdint.h>

#include "worker/base/status.h"

/* The caller reads all of it above the line. It writes `sent` before the count; `sent_at` and `got_at` until elements
 * are sent, where they do not follow one another. Ranges that are sent may overlap. */
struct kiln_exchange {
    MPI_Comm communicator; /* borrowed */
    int rank, ranks;
    uint64_t *sent, *sent_at; /* elements that go to each rank, and where the first one lies */
    uint64_t *got, *got_at;   /* those that come from each rank, and where the first one is put */
    uint64_t sent_all, got_all;
    /* ---- */
    uint64_t limit;
    const char *what;
    MPI_Datatype type;
    MPI_Request *requests;
    size_t request_count, request_room;
    int result; /* of MPI */
};

/* Collective. All counts are 0. `limit`: elements in a message, the same on all ranks; 0: what MPI counts (the option
 * exchange-limit has the same meaning). `what` names the elements in error messages, and is borrowed. The struct need
 * not be initialised. KILN_SYSTEM on all ranks. Release with kiln_exchange_release, in any case. */
int kiln_exchange_create(struct kiln_exchange *exchange, MPI_Comm communicator, uint64_t limit, const char *what,
                         struct kiln_error *error);
/* Not collective. Also of a struct that is all zeros. */
void kiln_exchange_release(struct kiln_exchange *exchange);

/* Not collective. Elements to each rank lie behind those to the rank before: sets `sent_at` and `sent_all`. */
void kiln_exchange_lay_out(struct kiln_exchange *exchange);
/* Not collective. What was sent is what comes, and the other way round: for answers in the order of questions. */
void kiln_exchange_turn(struct kiln_exchange *exchange);

/* Collective. Tells all ranks what comes to them: sets `got`, and `got_at` and `got_all` as if elements from each rank
 * are put behind those from the rank before. */
int kiln_exchange_count(struct kiln_exchange *exchange, int status, struct kiln_error *error);

/* Collective. Sends elements of `size` bytes from `out`, and receives at `in`, which may not overlap. Both belong to
 * the exchange until kiln_exchange_end; places that no rank's elements go to stay as they are. KILN_SYSTEM or another
 * rank's status: nothing has begun. */
int kiln_exchange_begin(struct kiln_exchange *exchange, int status, size_t size, const void *out, void *in,
                        struct kiln_error *error);
/* Collective. Waits until all elements have come. Call it whenever kiln_exchange_begin gave KILN_OK; `status` is that
 * of the work in between. KILN_RANK_LOST where MPI failed. */
int kiln_exchange_end(struct kiln_exchange *exchange, int status, struct kiln_error *error);

/* Collective. kiln_exchange_begin and kiln_exchange_end. */
int kiln_exchange_send(struct kiln_exchange *exchange, int status, size_t size, const void *out, void *in,
                       struct kiln_error *error);
/* Collective. Counts, takes memory for what comes, and sends. *in (the address of a pointer) receives `got_all`
 * elements, to be freed with kiln_free; NULL after an error. */
int kiln_exchange_all(struct kiln_exchange *exchange, int status, size_t size, const void *out, void *in,
                      struct kiln_error *error);

#endif
