/* Test of kiln_exchange, run by mpirun on three ranks: any counts, also none, in messages of any length, there and
 * back; and an error of one rank, which all ranks return, after which they exchange as before. */
#include <mpi.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/mpi/exchange.h"
#include "worker/base/memory.h"

enum { RANKS = 3, MOST = 300 };

struct element {
    unsigned char bytes[5];
};

static struct element element_of(int from, int to, uint64_t index)
{
    struct element e;
    for (unsigned i = 0; i < sizeof e.bytes; i++)
        e.bytes[i] = (unsigned char)((uint64_t)from * 101 + (uint64_t)to * 37 + index * 7 + i);
    return e;
}

static const uint64_t tables[][RANKS][RANKS] = {
    {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}},   {{1, 2, 3}, {4, 5, 6}, {7, 8, 9}}, {{0, 10, 0}, {0, 0, 0}, {0, 3, 0}},
    {{0, 0, 0}, {0, 0, 0}, {90, 0, 99}}, {{0, 3, 6}, {2, 0, 4}, {1, 7, 0}}, {{50, 0, 0}, {0, 50, 0}, {0, 0, 50}},
};

static int differ(const char *what, int rank, int other, uint64_t index)
{
    (void)fprintf(stderr, "%s: rank %d has a wrong element %llu of rank %d\n", what, rank, (unsigned long long)index,
                  other);
    return 1;
}

static void fill(const struct kiln_exchange *e, struct element *out)
{
    for (int r = 0; r < RANKS; r++)
        for (uint64_t i = 0; i < e->sent[r]; i++)
            out[e->sent_at[r] + i] = element_of(e->rank, r, i);
}

static int look(const struct kiln_exchange *e, const uint64_t wanted[RANKS][RANKS], const struct element *in)
{
    int wrong = 0;
    for (int r = 0; r < RANKS; r++) {
        wrong += e->got[r] != wanted[r][e->rank];
        for (uint64_t i = 0; i < e->got[r]; i++) {
            const struct element element = element_of(r, e->rank, i);
            if (memcmp(&in[e->got_at[r] + i], &element, sizeof element) != 0)
                wrong += differ("there", e->rank, r, i);
        }
    }
    return wrong;
}

/* The same elements back, in wider ones; each rank has then what it sent. */
static int back(struct kiln_exchange *e, const struct element *in, const struct element *out, struct kiln_error *error)
{
    struct {
        struct element element;
        unsigned char more[4];
    } wide[MOST] = {{{{0}}, {0}}}, answers[MOST];
    int wrong = 0;
    for (int r = 0; r < RANKS; r++)
        for (uint64_t i = 0; i < e->got[r]; i++)
            wide[e->got_at[r] + i].element = in[e->got_at[r] + i];
    const uint64_t sent = e->sent_all, got = e->got_all;
    kiln_exchange_turn(e);
    wrong += e->sent_all != got || e->got_all != sent;
    if (kiln_exchange_begin(e, KILN_OK, sizeof *wide, wide, answers, error) != KILN_OK ||
        kiln_exchange_end(e, KILN_OK, error) != KILN_OK)
        return 1;
    for (int r = 0; r < RANKS; r++)
        for (uint64_t i = 0; i < e->got[r]; i++)
            if (memcmp(&answers[e->got_at[r] + i].element, &out[e->got_at[r] + i], sizeof *out) != 0)
                wrong += differ("back", e->rank, r, i);
    kiln_exchange_turn(e);
    return wrong;
}

static int try_counts(const uint64_t counts[RANKS][RANKS], uint64_t limit)
{
    struct kiln_error error = {{0}};
    struct kiln_exchange e;
    struct element out[MOST], *in = NULL;
    if (kiln_exchange_create(&e, MPI_COMM_WORLD, limit, "elements", &error) != KILN_OK)
        return 1;
    memcpy(e.sent, counts[e.rank], RANKS * sizeof *e.sent);
    kiln_exchange_lay_out(&e);
    fill(&e, out);
    int wrong = kiln_exchange_all(&e, KILN_OK, sizeof *out, out, &in, &error) != KILN_OK || in == NULL;
    wrong += wrong != 0 ? 0 : look(&e, counts, in) + back(&e, in, out, &error);
    kiln_free(&in);
    kiln_exchange_release(&e);
    return wrong;
}

/* All ranks send the same range to each, and own elements are put behind a gap of one, in which nothing is written. */
static int try_places(void)
{
    static const uint64_t counts[RANKS][RANKS] = {{4, 4, 4}, {4, 4, 4}, {4, 4, 4}};
    struct kiln_error error = {{0}};
    struct kiln_exchange e;
    unsigned char out[4], in[16];
    if (kiln_exchange_create(&e, MPI_COMM_WORLD, 3, "elements", &error) != KILN_OK)
        return 1;
    memcpy(e.sent, counts[e.rank], RANKS * sizeof *e.sent);
    memset(out, e.rank + 1, sizeof out);
    memset(in, 99, sizeof in);
    int wrong = kiln_exchange_count(&e, KILN_OK, &error) != KILN_OK || e.got_all != 12;
    for (int r = e.rank; r < RANKS; r++)
        e.got_at[r]++;
    wrong += kiln_exchange_send(&e, KILN_OK, 1, out, in, &error) != KILN_OK;
    for (size_t i = 0; i < sizeof in && wrong == 0; i++) {
        const size_t gap = (size_t)e.rank * 4, from = i < gap ? i / 4 : (i - 1) / 4;
        wrong += in[i] != (i == gap || from >= RANKS ? 99 : from + 1);
    }
    kiln_exchange_release(&e);
    return wrong;
}

/* Rank 1 fails, before the counts, before the elements, or after them. */
static int try_error(int when)
{
    struct kiln_error error = {{0}};
    struct kiln_exchange e;
    unsigned char out[RANKS] = {1, 2, 3}, in[RANKS] = {0};
    int brought[3] = {KILN_OK, KILN_OK, KILN_OK}, status;
    KILN_TRY(kiln_exchange_create(&e, MPI_COMM_WORLD, 1, "elements", &error));
    for (int r = 0; r < RANKS; r++)
        e.sent[r] = 1;
    kiln_exchange_lay_out(&e);
    if (e.rank == 1)
        brought[when] = kiln_fail(&error, KILN_IO, "the disk is full");
    KILN_TRY(kiln_exchange_count(&e, brought[0], &error));
    KILN_TRY(kiln_exchange_begin(&e, brought[1], 1, out, in, &error));
    KILN_TRY(kiln_exchange_end(&e, brought[2], &error));
end:;
    int wrong = status != KILN_IO || strstr(error.message, "the disk is full") == NULL;
    wrong += strncmp(error.message, "rank 1 on ", 10) != 0;
    wrong += kiln_exchange_count(&e, KILN_OK, &error) != KILN_OK;
    wrong += kiln_exchange_send(&e, KILN_OK, 1, out, in, &error) != KILN_OK;
    for (int r = 0; r < RANKS; r++)
        wrong += in[r] != e.rank + 1;
    kiln_exchange_release(&e);
    return wrong;
}

/* Work between begin and end; two exchanges under way. */
static int try_both(void)
{
    struct kiln_error error = {{0}};
    struct kiln_exchange a, b;
    unsigned char out[RANKS], from_a[RANKS] = {0}, from_b[RANKS] = {0};
    int wrong = kiln_exchange_create(&a, MPI_COMM_WORLD, 1, "elements", &error) != KILN_OK;
    wrong += kiln_exchange_create(&b, MPI_COMM_WORLD, 1, "elements", &error) != KILN_OK;
    if (wrong > 0)
        return wrong;
    for (int r = 0; r < RANKS; r++) {
        a.sent[r] = b.sent[r] = 1;
        out[r] = (unsigned char)(10 * a.rank + r);
    }
    kiln_exchange_lay_out(&a);
    wrong += kiln_exchange_count(&a, KILN_OK, &error) != KILN_OK;
    wrong += kiln_exchange_count(&b, KILN_OK, &error) != KILN_OK; /* its elements are all out[0] */
    wrong += kiln_exchange_begin(&a, KILN_OK, 1, out, from_a, &error) != KILN_OK;
    wrong += kiln_exchange_begin(&b, KILN_OK, 1, out, from_b, &error) != KILN_OK;
    wrong += kiln_exchange_end(&b, KILN_OK, &error) != KILN_OK;
    wrong += kiln_exchange_end(&a, KILN_OK, &error) != KILN_OK;
    for (int r = 0; r < RANKS; r++)
        wrong += from_a[r] != 10 * r + a.rank || from_b[r] != 10 * r;
    kiln_exchange_release(&a);
    kiln_exchange_release(&b);
    return wrong;
}

int main(int argc, char **argv)
{
    static const uint64_t limits[] = {0, 1, 3};
    int size = 0, failures = 0, total = 0;
    MPI_Init(&argc, &argv);
    MPI_Comm_size(MPI_COMM_WORLD, &size);
    if (size != RANKS) {
        (void)fprintf(stderr, "this test wants three ranks, not %d\n", size);
        MPI_Abort(MPI_COMM_WORLD, 1);
    }
    for (size_t t = 0; t < sizeof tables / sizeof *tables; t++)
        for (size_t l = 0; l < sizeof limits / sizeof *limits; l++)
            failures += try_counts(tables[t], limits[l]);
    failures += try_places() + try_both();
    for (int when = 0; when < 3; when++)
        failures += try_error(when);
    MPI_Allreduce(&failures, &total, 1, MPI_INT, MPI_SUM, MPI_COMM_WORLD);
    MPI_Finalize();
    return total != 0;
}
