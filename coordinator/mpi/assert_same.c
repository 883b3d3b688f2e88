#include "coordinator/mpi/assert_same.h"

#include <stdlib.h>
#include <xxhash.h>

#include "coordinator/mpi/agree.h"

int kiln_same(MPI_Comm communicator, uint64_t value, const char *what, struct kiln_error *error)
{
    /* the largest value, and the complement of the least */
    const uint64_t own[2] = {value, ~value};
    uint64_t most[2] = {value, ~value};
    if (MPI_Allreduce(own, most, 2, MPI_UINT64_T, MPI_MAX, communicator) != MPI_SUCCESS)
        return kiln_fail(error, KILN_RANK_LOST, "a rank was lost while the ranks compared %s", what);
    if (most[0] == ~most[1])
        return KILN_OK;
    return kiln_fail(
        error, KILN_BUG,
        "the ranks disagree on %s, which has to be the same on all: it is %llu here, and from %llu to %llu "
        "on all; this is a bug of kiln",
        what, (unsigned long long)value, (unsigned long long)~most[1], (unsigned long long)most[0]);
}

void kiln_require_same(MPI_Comm communicator, uint64_t value, const char *what)
{
    struct kiln_error error = {{0}};
    const int status = kiln_same(communicator, value, what, &error);
    if (status != KILN_OK)
        kiln_end_all_ranks(status, &error);
}

void kiln_require_ranges(MPI_Comm communicator, uint64_t first, uint64_t count, uint64_t total, const char *what)
{
    struct kiln_error error = {{0}};
    int rank, ranks;
    uint64_t end = 0;
    (void)MPI_Comm_rank(communicator, &rank);
    (void)MPI_Comm_size(communicator, &ranks);
    (void)MPI_Scan(&count, &end, 1, MPI_UINT64_T, MPI_SUM, communicator);
    int status = KILN_OK;
    if (first != end - count || (rank == ranks - 1 && end != total))
        status = kiln_fail(&error, KILN_BUG,
                           "%s do not follow one another up to %llu: rank %d has %llu from %llu on, and the ranks up "
                           "to it have %llu; this is a bug of kiln",
                           what, (unsigned long long)total, rank, (unsigned long long)count, (unsigned long long)first,
                           (unsigned long long)end);
    status = kiln_agree(communicator, status, &error);
    if (status != KILN_OK)
        kiln_end_all_ranks(status, &error);
}

uint64_t kiln_hash_bytes(const void *data, size_t size) { return size > 0 ? XXH3_64bits(data, size) : 0; }

uint64_t kiln_hash_json_text(const json_t *json)
{
    char *text = json_dumps(json, JSON_COMPACT | JSON_SORT_KEYS | JSON_ENCODE_ANY);
    const uint64_t hash = text != NULL ? kiln_hash_bytes(text, strlen(text)) : 0;
    free(text);
    return hash;
}
