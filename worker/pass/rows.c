#include "worker/pass/rows.h"

#include <errno.h>
#include <string.h>
#include <unistd.h>
#include <xxhash.h>

#include "worker/pass/resident_rows.h"
#include "worker/pass/row_chains.h"

uint32_t kiln_rows_check(uint64_t key, uint64_t point, const uint32_t *words, uint32_t samples)
{
    const uint64_t seed = key ^ (point * 0x9e3779b97f4a7c15u) ^ ((uint64_t)samples << 48);
    const uint32_t check = (uint32_t)XXH3_64bits_withSeed(words, (size_t)samples * sizeof *words, seed);
    return check != 0 ? check : 1;
}

void kiln_rows_fail(struct kiln_rows *r, int status, const char *what, uint64_t point)
{
    const int reason = errno;
#pragma omp critical(kiln_rows_status)
    {
        errno = reason;
        if (r->status == KILN_OK && status == KILN_BAD_INPUT)
            r->status = kiln_fail(&r->error, status,
                                  "'%s' is not as it was written: the row of surface point %llu is %s; kiln verify "
                                  "says what else is damaged; bake again with --keep-transport rows",
                                  r->path, (unsigned long long)point, what);
        else if (r->status == KILN_OK)
            r->status = kiln_fail_errno(&r->error, status, "cannot %s '%s'", what, r->path);
    }
}

static off_t offset_of(const struct kiln_rows *r, uint64_t point)
{
    return (off_t)(KILN_ROWS_BEGIN + point * kiln_rows_row_bytes(r->samples));
}

bool kiln_rows_load(struct kiln_rows *r, uint32_t *rows, uint64_t point, uint64_t points, uint32_t samples)
{
    const size_t bytes = (size_t)(points * kiln_rows_row_bytes(samples));
    const off_t at = offset_of(r, point);
    if (r->resident != NULL) {
        memcpy(rows, kiln_resident_row(r->resident, point - r->resident->first), bytes);
        return true;
    }
    for (size_t done = 0; done < bytes;) {
        const ssize_t got = pread(r->file, (char *)rows + done, bytes - done, at + (off_t)done);
        if (got < 0 && errno == EINTR)
            continue;
        if (got < 0)
            kiln_rows_fail(r, KILN_IO, "read", 0);
        if (got <= 0)
            return false;
        done += (size_t)got;
    }
    return true;
}

bool kiln_rows_there(struct kiln_rows *r, const uint32_t *row, uint64_t point, uint32_t samples,
                     uint64_t surface_points)
{
    const uint32_t least = r->chains != NULL ? KILN_ROW_TINTED : KILN_ROW_BLOCKED;
    bool within = true;
    if (row[0] == 0)
        return false;
    for (uint32_t k = 1; k <= samples; k++)
        within &= (row[k] < surface_points) | (row[k] >= least);
    if (within && row[0] == kiln_rows_check(r->key, point, row + 1, samples))
        return true;
    kiln_rows_fail(r, KILN_BAD_INPUT, "damaged", point);
    return false;
}

bool kiln_rows_store(struct kiln_rows *r, const uint32_t *rows, uint64_t point, uint64_t points, uint32_t samples)
{
    const size_t bytes = (size_t)(points * kiln_rows_row_bytes(samples));
    const off_t at = offset_of(r, point);
    if (r->resident != NULL) {
        memcpy(kiln_resident_row(r->resident, point - r->resident->first), rows, bytes);
        return true;
    }
    for (size_t done = 0; done < bytes;) {
        const ssize_t put = pwrite(r->file, (const char *)rows + done, bytes - done, at + (off_t)done);
        if (put < 0 && errno != EINTR) {
            kiln_rows_fail(r, KILN_IO, "write", 0);
            return false;
        }
        done += put > 0 ? (size_t)put : 0;
    }
    return true;
}
