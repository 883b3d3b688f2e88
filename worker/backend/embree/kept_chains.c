#include "worker/backend/embree/kept_chains.h"

#include <errno.h>
#include <string.h>
#include <unistd.h>

#include "worker/base/memory.h"

void kept_chains_release(struct kept_chains *kept)
{
    for (uint32_t j = 0; j < RAY_LANES; j++)
        kiln_free(&kept->of[j].words);
    kiln_free(&kept->streams);
}

/* ---- of rays that are traced ---- */

void kept_chains_begin(struct kept_chains *kept, uint32_t points)
{
    for (uint32_t j = 0; j < points; j++)
        kept->of[j].count = 0;
}

/* Makes room for `count` more words; NULL: out of memory. */
static uint32_t *add_words(struct chain_notes *notes, size_t count)
{
    if (kiln_grow(&notes->words, &notes->room, notes->count + count, sizeof *notes->words, "kept chains", NULL) !=
        KILN_OK) {
        notes->failed = true;
        return NULL;
    }
    notes->count += count;
    return notes->words + notes->count - count;
}

struct chain_notes *kept_chains_ray(struct kept_chains *kept, uint32_t j, const float *tint)
{
    struct chain_notes *notes = &kept->of[j];
    kept->begin = notes->count;
    uint32_t *to = tint != NULL ? add_words(notes, 3) : NULL;
    if (to != NULL)
        memcpy(to, tint, 3 * sizeof *to);
    notes->last = UINT64_MAX;
    return notes;
}

void kept_chains_answer(struct chain_notes *notes, uint32_t point, const float weight[3])
{
    const bool grey = weight[0] == weight[1] && weight[0] == weight[2];
    const size_t floats = grey ? 1 : 3;
    uint32_t *to = add_words(notes, 1 + floats);
    if (to == NULL)
        return;
    to[0] = point | (grey ? KILN_CHAIN_GREY : 0);
    memcpy(to + 1, weight, floats * sizeof *to);
    notes->last = notes->count - 1 - floats;
}

uint32_t kept_chains_end(struct kept_chains *kept, uint32_t j, bool tinted)
{
    struct chain_notes *notes = &kept->of[j];
    if (notes->last == UINT64_MAX) { /* nobody sends anything */
        notes->count = kept->begin;
        return KILN_ROW_NO_POINT;
    }
    notes->words[notes->last] |= KILN_CHAIN_LAST;
    return tinted ? KILN_ROW_TINTED : KILN_ROW_CHAIN;
}

static bool put_at(int file, const void *from, size_t bytes, uint64_t at)
{
    for (size_t done = 0; done < bytes;) {
        const ssize_t put = pwrite(file, (const char *)from + done, bytes - done, (off_t)(at + done));
        if (put < 0 && errno != EINTR)
            return false;
        done += put > 0 ? (size_t)put : 0;
    }
    return true;
}

/* Concatenates all streams, in the order of points. */
static bool join(struct kept_chains *kept, const struct tile_run_frame *frame, uint64_t *words)
{
    size_t at = 0;
    bool failed = false;
    *words = 0;
    for (uint32_t j = 0; j < frame->count; j++) {
        *words += kept->of[j].count;
        failed = failed || kept->of[j].failed;
    }
    errno = ENOMEM;
    if (failed ||
        kiln_grow(&kept->streams, &kept->room, (size_t)*words, sizeof *kept->streams, "kept chains", NULL) != KILN_OK)
        return false;
    for (uint32_t j = 0; j < frame->count; at += kept->of[j++].count)
        if (kept->of[j].count > 0)
            memcpy(kept->streams + at, kept->of[j].words, kept->of[j].count * sizeof *kept->streams);
    return true;
}

static struct kiln_row_chain record_of(const struct kept_chains *kept, uint32_t j, uint64_t at,
                                       const struct kiln_point_result *r)
{
    struct kiln_row_chain record = {.spool = kept->file->number,
                                    .at = at,
                                    .words = kept->of[j].count,
                                    .escaped = r->escaped,
                                    .blocked = r->blocked};
    memcpy(record.glass, r->glass, sizeof record.glass);
    memcpy(record.gloss, r->gloss, sizeof record.gloss);
    return record;
}

bool kept_chains_write(struct kept_chains *kept, uint64_t key, uint64_t first, const struct tile_run_frame *frame,
                       const struct kiln_point_result *results)
{
    struct kiln_row_chains *f = kept->file;
    uint64_t words, at, done = 0;
    if (!join(kept, frame, &words))
        return false;
#pragma omp atomic capture
    {
        at = f->spool_words;
        f->spool_words += words;
    }
    if (!put_at(f->spool, kept->streams, (size_t)words * sizeof *kept->streams, at * sizeof *kept->streams))
        return false;
    for (uint32_t j = 0; j < frame->count; done += kept->of[j++].count) {
        const uint64_t point = first + frame->place[j];
        struct kiln_row_chain record = record_of(kept, j, at + done, &results[frame->place[j]]);
        record.check = kiln_row_chain_check(key, point, &record, kept->streams + done);
        if (!put_at(f->file, &record, sizeof record, kiln_row_chain_offset(point)))
            return false;
    }
    return true;
}

/* ---- chains of rays that are read ---- */

/* Reads bytes at an offset. False: the file is too short, or errno has the error. */
static bool get_at(int file, void *to, size_t bytes, uint64_t at)
{
    errno = 0;
    for (size_t done = 0; done < bytes;) {
        const ssize_t got = pread(file, (char *)to + done, bytes - done, (off_t)(at + done));
        if (got < 0 && errno == EINTR)
            continue;
        if (got <= 0)
            return false;
        done += (size_t)got;
    }
    return true;
}

int kept_chains_read(struct kept_chains *kept, uint64_t first, const uint32_t *place, uint32_t points)
{
    const struct kiln_row_chains *f = kept->file;
    const uint64_t begin = f->words_begin;
    uint64_t words = 0, done = 0;
    for (uint32_t j = 0, count; j < points; j += count) {
        for (count = 1; j + count < points && place[j + count] == place[j] + count; count++)
            ;
        if (!get_at(f->file, &kept->record[j], count * sizeof *kept->record, kiln_row_chain_offset(first + place[j])))
            return 0;
    }
    for (uint32_t j = 0; j < points; j++) {
        const struct kiln_row_chain *record = &kept->record[j];
        if (record->check == 0)
            return 0;
        if (record->spool != KILN_CHAIN_PACKED || record->at > f->words || record->words > f->words - record->at)
            return -1;
        words += record->words;
    }
    errno = ENOMEM;
    if (words > f->words ||
        kiln_grow(&kept->streams, &kept->room, (size_t)words, sizeof *kept->streams, "kept chains", NULL) != KILN_OK)
        return words > f->words ? -1 : 0;
    for (uint32_t j = 0; j < points;) { /* streams that follow one another are read together */
        const uint64_t at = kept->record[j].at, before = done;
        for (; j < points && kept->record[j].at == at + done - before; done += kept->record[j++].words)
            kept->next[j] = kept->streams + done;
        if (!get_at(f->file, kept->streams + before, (size_t)(done - before) * sizeof *kept->streams,
                    begin + at * sizeof *kept->streams))
            return 0;
    }
    return 1;
}

bool kept_chains_are_whole(const struct kept_chains *kept, uint64_t key, uint32_t j, uint64_t point,
                           const uint32_t *row, uint32_t samples, uint64_t points)
{
    const struct kiln_row_chain *record = &kept->record[j];
    return record->check == kiln_row_chain_check(key, point, record, kept->next[j]) &&
           kiln_row_chain_is_sound(record, kept->next[j], row, samples, points);
}
