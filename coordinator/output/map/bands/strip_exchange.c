#include "coordinator/output/map/bands/strip_exchange.h"

#include <omp.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

static const size_t MOST_BYTES =
    (size_t)512 << 20; /* limit of the messages that a packer holds, bytes, unless two strips are larger */

enum { TAG_VALUES = 50, TAG_REPORT = 51, TAG_PACKED = 52 };

/* Header of a strip message: its channels. The values follow. */
struct channel_words {
    uint32_t count;
    struct {
        char name[KILN_CHANNEL_NAME_SIZE];
        uint32_t half;
    } channel[KILN_EXR_CHANNELS];
};

/* The reply of a packer for a strip. The packed bytes follow unless packing failed. */
struct report {
    int32_t status;
    uint32_t index; /* of the strip in its stream */
    uint64_t size, hash, values;
    struct kiln_error error;
};

static int mpi_failed(struct kiln_error *error)
{
    return kiln_fail(error, KILN_RANK_LOST, "MPI failed while lightmaps were packed by all ranks");
}

static size_t values_of(const struct kiln_lightmap *map, uint32_t row)
{
    const uint32_t rows = map->height - row < KILN_EXR_ROWS ? map->height - row : KILN_EXR_ROWS;
    return (size_t)rows * map->width;
}

/* ---- the packer ---- */

/* A strip at its packer, until the reply has been sent. */
struct slot {
    uint8_t *message; /* header, then the values of the channels */
    struct report report;
    struct kiln_exr_strip packed;
    MPI_Request requests[3]; /* of the values, the report and the packed bytes */
};

struct helper {
    MPI_Comm communicator;
    const struct kiln_strip_assignment *strips;
    const struct kiln_lightmap *lightmaps;
    size_t *list, count;
    struct slot *slots; /* two groups of slots: one is packed while the other is sent or received */
    size_t group, room; /* number of slots in a group; size of a message, bytes */
    size_t channels;    /* of an image, at most */
    int (*pack)(const struct helper *h, struct slot *slot, size_t i, size_t bytes, struct kiln_error *error);
};

static size_t message_bytes(size_t channels, size_t values)
{
    return sizeof(struct channel_words) + channels * values * sizeof(float);
}

static void destroy_helper(struct helper *h)
{
    for (size_t s = 0; h->slots != NULL && s < 2 * h->group; s++) {
        kiln_free(&h->slots[s].message);
        kiln_free(&h->slots[s].packed.bytes);
    }
    kiln_free(&h->slots);
    kiln_free(&h->list);
}

/* Returns the number of strips in a group: one per thread, within the limit of memory. */
static size_t size_of_group(const struct helper *h)
{
    const size_t threads = (size_t)omp_get_max_threads(), fit = h->room > 0 ? MOST_BYTES / (2 * h->room) : 0;
    size_t group = h->count < threads ? h->count : threads;
    if (group > fit)
        group = fit;
    return group == 0 && h->count > 0 ? 1 : group;
}

static int create_helper(struct helper *h, int rank, struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_allocate(&h->list, h->strips->count, sizeof *h->list, "strips to pack", error));
    h->count = kiln_strip_list(h->strips, (uint32_t)rank, h->list);
    for (size_t i = 0; i < h->count; i++) {
        const struct kiln_strip *strip = &h->strips->strips[h->list[i]];
        const size_t bytes = message_bytes(h->channels, values_of(&h->lightmaps[strip->object], strip->row));
        h->room = bytes > h->room ? bytes : h->room;
    }
    h->group = size_of_group(h);
    KILN_TRY(kiln_allocate(&h->slots, 2 * h->group, sizeof *h->slots, "strips to pack", error));
    for (size_t s = 0; s < 2 * h->group; s++) {
        for (int i = 0; i < 3; i++)
            h->slots[s].requests[i] = MPI_REQUEST_NULL;
        KILN_TRY(kiln_allocate(&h->slots[s].message, h->room, 1, "strips to pack", error));
    }
end:
    return status;
}

static const struct kiln_strip *strip_at(const struct helper *h, size_t i) { return &h->strips->strips[h->list[i]]; }

/* Makes an image that borrows the values in a message. False if the message does not belong to the strip. */
static bool view_message(const struct helper *h, const struct slot *slot, size_t i, size_t bytes,
                         struct kiln_image *view, struct kiln_image_channel *channels)
{
    const struct kiln_strip *strip = strip_at(h, i);
    const struct kiln_lightmap *map = &h->lightmaps[strip->object];
    const size_t values = values_of(map, strip->row);
    const struct channel_words *words = (const struct channel_words *)slot->message;
    if (bytes < sizeof *words || words->count > KILN_EXR_CHANNELS ||
        bytes != sizeof *words + words->count * values * sizeof(float))
        return false;
    *view = (struct kiln_image){.width = map->width,
                                .height = (uint32_t)(values / map->width),
                                .channel_count = words->count,
                                .channels = channels};
    for (size_t c = 0; c < words->count; c++) {
        memcpy(channels[c].name, words->channel[c].name, sizeof channels[c].name);
        channels[c].half = words->channel[c].half != 0;
        channels[c].values = (float *)(slot->message + sizeof *words) + c * values;
    }
    return true;
}

static int pack_message(const struct helper *h, struct slot *slot, size_t i, size_t bytes, struct kiln_error *error)
{
    struct kiln_image view;
    struct kiln_image_channel channels[KILN_EXR_CHANNELS];
    if (!view_message(h, slot, i, bytes, &view, channels))
        return kiln_fail(error, KILN_BUG, "%zu bytes came that are not row %u of object %u", bytes, strip_at(h, i)->row,
                         strip_at(h, i)->object);
    return kiln_exr_strip_pack(&view, 0, &slot->packed, error);
}

/* Fails as a packer, in place of view_message and packing; for tests. */
static int refuse_to_pack(const struct helper *h, struct slot *slot, size_t i, size_t bytes, struct kiln_error *error)
{
    (void)h, (void)slot, (void)i, (void)bytes;
    return kiln_fail(error, KILN_SYSTEM, "KILN_FAILING_PACKER wants packing to fail here");
}

/* Receives the strips of a group, after the sends of its previous strips have completed. */
static int expect_group(struct helper *h, size_t first)
{
    for (size_t k = 0; k < h->group && first + k < h->count; k++) {
        struct slot *slot = &h->slots[(first + k) % (2 * h->group)];
        if (MPI_Waitall(3, slot->requests, MPI_STATUSES_IGNORE) != MPI_SUCCESS)
            return KILN_RANK_LOST;
        kiln_free(&slot->packed.bytes);
        if (MPI_Irecv(slot->message, (int)h->room, MPI_BYTE, (int)strip_at(h, first + k)->owner, TAG_VALUES,
                      h->communicator, &slot->requests[0]) != MPI_SUCCESS)
            return KILN_RANK_LOST;
    }
    return KILN_OK;
}

/* Sends the reply for a strip. An empty message gets none, since its owner has given up. */
static int answer(struct helper *h, struct slot *slot, int owner)
{
    const int report = MPI_Isend(&slot->report, (int)sizeof slot->report, MPI_BYTE, owner, TAG_REPORT, h->communicator,
                                 &slot->requests[1]);
    if (report != MPI_SUCCESS || slot->report.status != KILN_OK)
        return report;
    return MPI_Isend(slot->packed.bytes, (int)slot->packed.size, MPI_BYTE, owner, TAG_PACKED, h->communicator,
                     &slot->requests[2]);
}

static int pack_group(struct helper *h, size_t first, int *bytes)
{
    const size_t end = first + h->group < h->count ? first + h->group : h->count;
    for (size_t i = first; i < end; i++) {
        MPI_Status received;
        if (MPI_Wait(&h->slots[i % (2 * h->group)].requests[0], &received) != MPI_SUCCESS ||
            MPI_Get_count(&received, MPI_BYTE, &bytes[i - first]) != MPI_SUCCESS)
            return KILN_RANK_LOST;
    }
#pragma omp parallel for schedule(dynamic, 1)
    for (size_t i = first; i < end; i++) {
        struct slot *slot = &h->slots[i % (2 * h->group)];
        slot->report = (struct report){.index = strip_at(h, i)->index};
        if (bytes[i - first] == 0)
            continue;
        slot->report.status = h->pack(h, slot, i, (size_t)bytes[i - first], &slot->report.error);
        slot->report.size = slot->packed.size;
        slot->report.hash = slot->packed.hash;
        slot->report.values = slot->packed.values;
    }
    for (size_t i = first; i < end; i++) {
        struct report *report = &h->slots[i % (2 * h->group)].report;
        kiln_name_rank(report->status, &report->error);
        if (bytes[i - first] != 0 &&
            answer(h, &h->slots[i % (2 * h->group)], (int)strip_at(h, i)->owner) != MPI_SUCCESS)
            return KILN_RANK_LOST;
    }
    return KILN_OK;
}

/* Packs the strips that this rank has to pack for others. Packing errors are reported to the owner, which passes them
 * on to all; only MPI errors are returned. */
static int help(struct helper *h, int *bytes)
{
    int status;
    KILN_TRY(expect_group(h, 0));
    for (size_t first = 0; first < h->count; first += h->group) {
        KILN_TRY(expect_group(h, first + h->group));
        KILN_TRY(pack_group(h, first, bytes));
    }
    for (size_t s = 0; s < 2 * h->group; s++)
        if (MPI_Waitall(3, h->slots[s].requests, MPI_STATUSES_IGNORE) != MPI_SUCCESS)
            KILN_TRY(KILN_RANK_LOST);
end:
    return status;
}

/* ---- the owner ---- */

/* State of a strip at its owner. */
struct passage {
    struct kiln_exr_strip packed;
    MPI_Request sent;
    bool ready; /* it has been packed or given up */
};

struct owner {
    MPI_Comm communicator;
    const struct kiln_strip *stream;
    const struct kiln_lightmap *lightmaps;
    const struct kiln_strip_source *sources;
    size_t source_count, source; /* `source`: the one being written */
    struct channel_words *words; /* header of each source, from which it is sent */
    uint32_t rank, count;
    uint32_t sent, own, written; /* numbers of strips: sent or kept; examined for own packing; written */
    struct passage *passages;
    uint8_t *spare;        /* receives a message when memory is short; as large as the largest message */
    size_t room, channels; /* size of that; channels of an image, at most */
    int status;            /* of the first failure; its message is in `error` */
    struct kiln_error error;
};

static void destroy_owner(struct owner *o)
{
    for (size_t i = 0; o->passages != NULL && i < o->count; i++)
        kiln_free(&o->passages[i].packed.bytes);
    kiln_free(&o->passages);
    kiln_free(&o->words);
    kiln_free(&o->spare);
}

static int describe_channels(const struct kiln_image *image, struct channel_words *words, struct kiln_error *error)
{
    if (image->channel_count > KILN_EXR_CHANNELS)
        return kiln_fail(error, KILN_BUG, "an image of %zu channels cannot be packed in strips, %d at most",
                         image->channel_count, KILN_EXR_CHANNELS);
    words->count = (uint32_t)image->channel_count;
    for (size_t c = 0; c < image->channel_count; c++) {
        memcpy(words->channel[c].name, image->channels[c].name, sizeof words->channel[c].name);
        words->channel[c].half = image->channels[c].half;
    }
    return KILN_OK;
}

static int create_owner(struct owner *o, struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_allocate(&o->passages, o->count, sizeof *o->passages, "strips on their way", error));
    KILN_TRY(kiln_allocate(&o->words, o->source_count, sizeof *o->words, "strips on their way", error));
    for (size_t i = 0; i < o->source_count; i++)
        KILN_TRY(describe_channels(o->sources[i].image, &o->words[i], error));
    for (size_t i = 0; i < o->count; i++) {
        const size_t bytes =
            message_bytes(o->channels, values_of(&o->lightmaps[o->stream[i].object], o->stream[i].row));
        o->room = bytes > o->room ? bytes : o->room;
        o->passages[i].sent = MPI_REQUEST_NULL;
    }
    KILN_TRY(kiln_allocate(&o->spare, o->room, 1, "strips on their way", error));
end:
    return status;
}

/* Records the first failure. */
static void give_up(struct owner *o, int status, const struct kiln_error *error)
{
    if (status == KILN_OK || o->status != KILN_OK)
        return;
    o->status = status;
    o->error = *error;
}

static size_t source_of(const struct owner *o, uint32_t object)
{
    size_t i = 0;
    while (o->sources[i].object != object)
        i++;
    return i;
}

/* Makes an MPI datatype for the header and the values at their places in memory. */
static int describe_strip(const struct owner *o, const struct kiln_strip *strip, MPI_Datatype *type)
{
    const size_t source = source_of(o, strip->object), values = values_of(&o->lightmaps[strip->object], strip->row);
    const struct kiln_image *image = o->sources[source].image;
    int lengths[1 + KILN_EXR_CHANNELS] = {(int)sizeof *o->words};
    MPI_Aint places[1 + KILN_EXR_CHANNELS];
    int done = MPI_Get_address(&o->words[source], &places[0]);
    for (size_t c = 0; done == MPI_SUCCESS && c < image->channel_count; c++) {
        lengths[c + 1] = (int)(values * sizeof(float));
        done = MPI_Get_address(image->channels[c].values + (size_t)strip->row * image->width, &places[c + 1]);
    }
    if (done == MPI_SUCCESS)
        done = MPI_Type_create_hindexed(1 + (int)image->channel_count, lengths, places, MPI_BYTE, type);
    return done == MPI_SUCCESS ? MPI_Type_commit(type) : done;
}

static int send_strip(struct owner *o, uint32_t i)
{
    const struct kiln_strip *strip = &o->stream[i];
    MPI_Datatype type;
    if (o->status != KILN_OK) {
        o->passages[i].ready = true;
        return MPI_Send(NULL, 0, MPI_BYTE, (int)strip->packer, TAG_VALUES, o->communicator);
    }
    int done = describe_strip(o, strip, &type);
    if (done == MPI_SUCCESS) {
        done = MPI_Isend(MPI_BOTTOM, 1, type, (int)strip->packer, TAG_VALUES, o->communicator, &o->passages[i].sent);
        (void)MPI_Type_free(&type); /* MPI frees it when it is no longer in use */
    }
    return done;
}

static int send_some(struct owner *o)
{
    for (; o->sent < o->count && o->sent < o->written + KILN_STRIPS_ON_WAY; o->sent++)
        if (o->stream[o->sent].packer != o->rank && send_strip(o, o->sent) != MPI_SUCCESS)
            return KILN_RANK_LOST;
    return KILN_OK;
}

static bool is_own(const struct owner *o, uint32_t i) { return o->stream[i].packer == o->rank; }

static void pack_own(struct owner *o, uint32_t i)
{
    const struct kiln_strip *strip = &o->stream[i];
    struct kiln_error mine = {{0}};
    const int status =
        kiln_exr_strip_pack(o->sources[source_of(o, strip->object)].image, strip->row, &o->passages[i].packed, &mine);
    o->passages[i].ready = true;
#pragma omp critical(kiln_pack_own)
    give_up(o, status, &mine);
}

/* Packs strips that this rank keeps, one per thread. Returns false if there are none at present. */
static bool pack_some(struct owner *o)
{
    enum { AT_ONCE = 64 };
    uint32_t chosen[AT_ONCE], count = 0;
    const uint32_t threads = (uint32_t)omp_get_max_threads(), most = threads < AT_ONCE ? threads : AT_ONCE;
    for (; o->own < o->sent && count < most; o->own++)
        if (is_own(o, o->own))
            chosen[count++] = o->own;
    if (o->status != KILN_OK)
        for (uint32_t i = 0; i < count; i++)
            o->passages[chosen[i]].ready = true;
    else
#pragma omp parallel for schedule(dynamic, 1)
        for (uint32_t i = 0; i < count; i++)
            pack_own(o, chosen[i]);
    return count > 0;
}

/* Receives a report and the packed bytes that follow it. */
static int take_strip(struct owner *o, int from)
{
    struct report report;
    struct kiln_error mine = {{0}};
    if (MPI_Recv(&report, (int)sizeof report, MPI_BYTE, from, TAG_REPORT, o->communicator, MPI_STATUS_IGNORE) !=
        MPI_SUCCESS)
        return KILN_RANK_LOST;
    struct passage *p = &o->passages[report.index];
    const struct kiln_strip *strip = &o->stream[report.index];
    p->ready = true;
    give_up(o, report.status, &report.error);
    if (report.status == KILN_OK) {
        const int status = kiln_allocate(&p->packed.bytes, report.size, 1, "packed strips", &mine);
        give_up(o, status, &mine);
        if (MPI_Recv(status == KILN_OK ? p->packed.bytes : o->spare, (int)report.size, MPI_BYTE, from, TAG_PACKED,
                     o->communicator, MPI_STATUS_IGNORE) != MPI_SUCCESS)
            return KILN_RANK_LOST;
        p->packed.size = report.size;
        p->packed.hash = report.hash;
        if (report.values != kiln_exr_strip_values(o->sources[source_of(o, strip->object)].image, strip->row))
            give_up(o,
                    kiln_fail(&mine, KILN_BUG, "object %u: row %u came to rank %d as something else", strip->object,
                              strip->row, from),
                    &mine);
    }
    return MPI_Wait(&p->sent, MPI_STATUS_IGNORE) == MPI_SUCCESS ? KILN_OK : KILN_RANK_LOST;
}

/* Receives all replies that have arrived; with `wait` at least one. */
static int take_some(struct owner *o, bool wait)
{
    for (;; wait = false) {
        int there = 1;
        MPI_Status found;
        const int done = wait ? MPI_Probe(MPI_ANY_SOURCE, TAG_REPORT, o->communicator, &found)
                              : MPI_Iprobe(MPI_ANY_SOURCE, TAG_REPORT, o->communicator, &there, &found);
        if (done != MPI_SUCCESS)
            return KILN_RANK_LOST;
        if (!there)
            return KILN_OK;
        const int status = take_strip(o, found.MPI_SOURCE);
        if (status != KILN_OK)
            return status;
    }
}

/* Writes the packed strips in order. If the stream was given up, only drops them. */
static void write_some(struct owner *o)
{
    for (; o->written < o->count && o->passages[o->written].ready; o->written++) {
        const struct kiln_strip *strip = &o->stream[o->written];
        struct kiln_exr_strip *packed = &o->passages[o->written].packed;
        struct kiln_exr_file *file = o->sources[source_of(o, strip->object)].file;
        const bool last = o->written + 1 == o->count || o->stream[o->written + 1].object != strip->object;
        struct kiln_error mine = {{0}};
        if (o->status == KILN_OK)
            give_up(o, kiln_exr_file_append(file, packed->bytes, packed->size, packed->hash, &mine), &mine);
        if (o->status == KILN_OK && last)
            give_up(o, kiln_exr_file_publish(file, &mine), &mine);
        kiln_free(&packed->bytes);
    }
}

static int run_stream(struct owner *o)
{
    int status = KILN_OK;
    while (status == KILN_OK && o->written < o->count) {
        status = send_some(o);
        if (status == KILN_OK)
            status = take_some(o, !pack_some(o) && !o->passages[o->written].ready);
        write_some(o);
    }
    return status;
}

/* ---- owner and packer ---- */

static int take_part(struct owner *owner, struct helper *helper, struct kiln_error *error)
{
    int *bytes = NULL;
    int status = kiln_agree(helper->communicator,
                            kiln_allocate(&bytes, helper->group, sizeof *bytes, "strips to pack", error), error);
    if (status != KILN_OK)
        return status;
    if (owner->count > 0)
        status = run_stream(owner);
    else if (helper->count > 0)
        status = help(helper, bytes);
    kiln_free(&bytes);
    if (status != KILN_OK)
        return mpi_failed(error);
    if (owner->status != KILN_OK)
        status = kiln_fail(error, owner->status, "%s", owner->error.message);
    return kiln_agree(helper->communicator, status, error);
}

/* Collective. Returns the largest number of channels of any rank's images. */
static int count_channels(MPI_Comm communicator, const struct kiln_strip_source *sources, size_t count,
                          size_t *channels, struct kiln_error *error)
{
    uint64_t most = 0;
    for (size_t i = 0; i < count; i++)
        most = sources[i].image->channel_count > most ? sources[i].image->channel_count : most;
    if (MPI_Allreduce(MPI_IN_PLACE, &most, 1, MPI_UINT64_T, MPI_MAX, communicator) != MPI_SUCCESS)
        return mpi_failed(error);
    *channels = (size_t)most;
    return KILN_OK;
}

int kiln_strips_write(MPI_Comm communicator, const struct kiln_strip_assignment *strips,
                      const struct kiln_lightmap *lightmaps, const struct kiln_strip_source *sources,
                      size_t source_count, const struct kiln_faults *faults, struct kiln_error *error)
{
    int rank = 0;
    size_t first = 0, channels = 0;
    if (strips->count == 0)
        return KILN_OK;
    if (MPI_Comm_rank(communicator, &rank) != MPI_SUCCESS)
        return mpi_failed(error);
    int status = count_channels(communicator, sources, source_count, &channels, error);
    if (status != KILN_OK)
        return status;
    struct owner owner = {.communicator = communicator,
                          .channels = channels,
                          .lightmaps = lightmaps,
                          .sources = sources,
                          .source_count = source_count,
                          .rank = (uint32_t)rank};
    owner.count = (uint32_t)kiln_strip_stream(strips, (uint32_t)rank, &first);
    owner.stream = strips->strips + first;
    struct helper helper = {.communicator = communicator,
                            .channels = channels,
                            .strips = strips,
                            .lightmaps = lightmaps,
                            .pack = kiln_faults_packer_fails(faults, (uint32_t)rank) ? refuse_to_pack : pack_message};
    status = create_helper(&helper, rank, error);
    if (status == KILN_OK && owner.count > 0)
        status = create_owner(&owner, error);
    status = kiln_agree(communicator, status, error);
    if (status == KILN_OK)
        status = take_part(&owner, &helper, error);
    destroy_owner(&owner);
    destroy_helper(&helper);
    return status;
}
