/* Checks of arguments that have to be the same on all ranks of a collective call. Ranks that disagree would wait for
 * each other for ever, or send each other ranges that do not fit. Debug builds (NDEBUG is not defined) check them;
 * other builds have no such code. */
#ifndef KILN_COORDINATOR_MPI_ASSERT_SAME_H
#define KILN_COORDINATOR_MPI_ASSERT_SAME_H

#include <jansson.h>
#include <mpi.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "worker/base/status.h"

/* kiln_assert_same(communicator, value, what): collective. Ends all ranks with KILN_BUG, and with a sentence that names
 * `what` and both values, unless all have the same `value` (an integer of at most 64 bits).
 * kiln_assert_same_bytes(communicator, data, size, what): the same for `size` bytes.
 * kiln_assert_same_text(communicator, text, what), kiln_assert_same_json(communicator, json, what): the same for a
 * string, and for a JSON value.
 * kiln_assert_ranges(communicator, first, count, total, what): collective. The same unless the ranges [first, first +
 * count) follow one another in the order of the ranks and cover [0, total). */
#ifdef NDEBUG
#    define kiln_assert_same(communicator, value, what) ((void)0)
#    define kiln_assert_same_bytes(communicator, data, size, what) ((void)0)
#    define kiln_assert_same_text(communicator, text, what) ((void)0)
#    define kiln_assert_same_json(communicator, json, what) ((void)0)
#    define kiln_assert_ranges(communicator, first, count, total, what) ((void)0)
#else
#    define kiln_assert_same(communicator, value, what) kiln_require_same(communicator, (uint64_t)(value), what)
#    define kiln_assert_same_bytes(communicator, data, size, what)                                                     \
        kiln_require_same(communicator, kiln_hash_bytes(data, size), what)
#    define kiln_assert_same_text(communicator, text, what)                                                            \
        kiln_assert_same_bytes(communicator, text, strlen(text), what)
#    define kiln_assert_same_json(communicator, json, what)                                                            \
        kiln_require_same(communicator, kiln_hash_json_text(json), what)
#    define kiln_assert_ranges(communicator, first, count, total, what)                                                \
        kiln_require_ranges(communicator, first, count, total, what)
#endif

/* Collective. KILN_OK, or on all ranks KILN_BUG with this rank's value, the least and the largest one in its sentence.
 */
int kiln_same(MPI_Comm communicator, uint64_t value, const char *what, struct kiln_error *error);
/* Collective. Checks likewise, and on failure ends all ranks with that message. */
void kiln_require_same(MPI_Comm communicator, uint64_t value, const char *what);
/* Collective. Implements kiln_assert_ranges. */
void kiln_require_ranges(MPI_Comm communicator, uint64_t first, uint64_t count, uint64_t total, const char *what);

/* XXH3 hash of the bytes; 0 if there are none. Not collective. */
uint64_t kiln_hash_bytes(const void *data, size_t size);
/* XXH3 hash of the value's compact text with sorted keys; 0 for NULL. Not collective. */
uint64_t kiln_hash_json_text(const json_t *json);

#endif
