#include "coordinator/bake/shares.h"

#include <string.h>

#include "coordinator/cli/agree.h"
#include "worker/base/memory.h"

/* What an array has one element for; `per_board` arrays have one in all. */
enum unit { PER_BOARD, PER_FRAGMENT, PER_FRAGMENT_AND_END, PER_POINT, PER_PIECE, PER_AREA_SHARE };
/* Which memory it lies in. */
enum place { OF_SURFACE, OF_RESULTS, OF_WORK, PLACES };

struct array {
    size_t offset; /* of its pointer in struct kiln_share */
    size_t size;
    enum unit unit;
    enum place place;
};

#define AT(member) offsetof(struct kiln_share, member)
#define SIZE(member) sizeof *((struct kiln_share *)NULL)->member

static const struct array arrays[] = {
    {AT(surface.fragments), SIZE(surface.fragments), PER_FRAGMENT, OF_SURFACE},
    {AT(surface.piece_base), SIZE(surface.piece_base), PER_FRAGMENT_AND_END, OF_SURFACE},
    {AT(surface.share_base), SIZE(surface.share_base), PER_FRAGMENT_AND_END, OF_SURFACE},
    {AT(surface.piece_count), SIZE(surface.piece_count), PER_POINT, OF_SURFACE},
    {AT(surface.pieces), SIZE(surface.pieces), PER_PIECE, OF_SURFACE},
    {AT(surface.shares), SIZE(surface.shares), PER_AREA_SHARE, OF_SURFACE},
    {AT(surface.albedo), 3 * SIZE(surface.albedo), PER_POINT, OF_SURFACE},
    {AT(surface.area), SIZE(surface.area), PER_POINT, OF_SURFACE},
    {AT(surface.visible), SIZE(surface.visible), PER_POINT, OF_SURFACE},
    {AT(direct), 3 * SIZE(direct), PER_POINT, OF_RESULTS},
    {AT(sum), 3 * SIZE(sum), PER_POINT, OF_RESULTS},
    {AT(error), SIZE(error), PER_POINT, OF_RESULTS},
    {AT(next), SIZE(next), PER_POINT, OF_WORK},
    {AT(board), SIZE(board), PER_BOARD, OF_WORK},
};
enum { ARRAYS = sizeof arrays / sizeof *arrays };

/* Of a share; what the ranks of a node tell each other. */
struct extent {
    uint64_t first, points, fragments, pieces, area_shares;
};

struct kiln_shares {
    const struct kiln_node_memory *node; /* NULL: nothing is lent */
    struct kiln_surface *surface;
    int count, own;
    struct kiln_node_parts *parts[PLACES]; /* NULL: of the surface, as it was built */
    struct kiln_share *share;              /* count */
};

static size_t count_of(const struct extent *e, enum unit unit)
{
    switch (unit) {
    case PER_FRAGMENT:
        return (size_t)e->fragments;
    case PER_FRAGMENT_AND_END:
        return (size_t)e->fragments + 1;
    case PER_POINT:
        return (size_t)e->points;
    case PER_PIECE:
        return (size_t)e->pieces;
    case PER_AREA_SHARE:
        return (size_t)e->area_shares;
    case PER_BOARD:
        break;
    }
    return 1;
}

static void *pointer_at(const struct kiln_share *share, const struct array *array)
{
    void *pointer;
    memcpy(&pointer, (const char *)share + array->offset, sizeof pointer);
    return pointer;
}

static void set_pointer(struct kiln_share *share, const struct array *array, void *pointer)
{
    memcpy((char *)share + array->offset, &pointer, sizeof pointer);
}

/* Points the share's arrays of a place into the part that begins at `base` (NULL: does not); gives the bytes that they take. */
static size_t lay_out(struct kiln_share *share, const struct extent *extent, enum place place, char *base)
{
    size_t at = 0;
    for (int i = 0; i < ARRAYS; i++) {
        if (arrays[i].place != place)
            continue;
        if (base != NULL)
            set_pointer(share, &arrays[i], base + at);
        at += (count_of(extent, arrays[i].unit) * arrays[i].size + 63) / 64 * 64;
    }
    return at;
}

static struct extent extent_of(const struct kiln_surface *s)
{
    return (struct extent){s->first, s->count, s->fragment_count, s->piece_base[s->fragment_count], s->share_base[s->fragment_count]};
}

/* Collective on the node. Makes a part for each of the node's arrays of a place, and points all shares there. */
static int make_parts(struct kiln_shares *s, const struct extent *extents, enum place place, const char *what, struct kiln_error *error)
{
    const int status = kiln_node_parts_create(&s->parts[place], s->node, lay_out(NULL, &extents[s->own], place, NULL), what, error);
    for (int i = 0; i < s->count && status == KILN_OK; i++)
        (void)lay_out(&s->share[i], &extents[i], place, kiln_node_part(s->parts[place], i));
    return status;
}

/* One array after the other, so that little is there twice. */
static void move_surface(struct kiln_shares *s, const struct extent *extent)
{
    struct kiln_share before = {.surface = *s->surface};
    for (int i = 0; i < ARRAYS; i++) {
        if (arrays[i].place != OF_SURFACE)
            continue;
        void *old = pointer_at(&before, &arrays[i]);
        memcpy(pointer_at(&s->share[s->own], &arrays[i]), old, count_of(extent, arrays[i].unit) * arrays[i].size);
        kiln_free(&old);
    }
    *s->surface = s->share[s->own].surface;
    s->surface->share_is_lent = true;
}

/* Collective on the node. */
static int lend_surface(struct kiln_shares *s, const struct extent *extents, struct kiln_error *error)
{
    for (int i = 0; i < s->count; i++) {
        struct kiln_surface *view = &s->share[i].surface;
        *view = *s->surface;
        view->first = extents[i].first;
        view->count = extents[i].points;
        view->fragment_count = (size_t)extents[i].fragments;
    }
    const int status = make_parts(s, extents, OF_SURFACE, "the surface points", error);
    if (status == KILN_OK)
        move_surface(s, &extents[s->own]);
    return status;
}

/* A rank alone with its share. */
static void keep_to_oneself(struct kiln_shares *s, struct extent *extents)
{
    extents[0] = extent_of(s->surface);
    s->node = NULL;
    s->count = 1;
    s->own = 0;
    s->share[0] = (struct kiln_share){.surface = *s->surface};
}

/* Collective on the node. */
static int make_results(struct kiln_shares *s, const struct extent *extents, struct kiln_error *error)
{
    const int status = make_parts(s, extents, OF_RESULTS, "irradiance", error);
    return status == KILN_OK ? make_parts(s, extents, OF_WORK, "the radiosity of a bounce", error) : status;
}

/* Collective on the node. */
static int fill(struct kiln_shares *s, struct extent *extents, struct kiln_error *error)
{
    if (s->node != NULL && lend_surface(s, extents, NULL) == KILN_OK && make_results(s, extents, NULL) == KILN_OK)
        return KILN_OK;
    kiln_shares_end(s);
    kiln_node_parts_destroy(&s->parts[OF_RESULTS]);
    keep_to_oneself(s, extents);
    return make_results(s, extents, error);
}

int kiln_shares_create(struct kiln_shares **shares, const struct kiln_node_memory *node, struct kiln_surface *surface, bool lend,
                       struct kiln_error *error)
{
    const int ranks = kiln_node_ranks(node);
    struct kiln_shares *s = NULL;
    struct extent *extents = NULL;
    *shares = NULL;
    int status = kiln_allocate(&s, 1, sizeof *s, "the shares of a node", error);
    if (status == KILN_OK)
        status = kiln_allocate(&s->share, (size_t)ranks, sizeof *s->share, "the shares of a node", error);
    if (status == KILN_OK)
        status = kiln_allocate(&extents, (size_t)ranks, sizeof *extents, "the shares of a node", error);
    if (status == KILN_OK && surface->fragment_count >= UINT32_MAX)
        status = kiln_fail(error, KILN_SYSTEM, "%zu pieces of lightmap tiles are too many for one rank: use more ranks", surface->fragment_count);
    status = kiln_agree(kiln_node_communicator(node), status, error);
    if (status == KILN_OK) {
        const struct extent own = extent_of(surface);
        s->node = lend && ranks > 1 ? node : NULL;
        s->surface = surface;
        s->count = ranks;
        s->own = kiln_node_rank(node);
        (void)MPI_Allgather(&own, sizeof own, MPI_BYTE, extents, sizeof own, MPI_BYTE, kiln_node_communicator(node));
        status = kiln_agree(kiln_node_communicator(node), fill(s, extents, error), error);
    }
    kiln_free(&extents);
    *shares = s;
    if (status != KILN_OK)
        kiln_shares_destroy(shares);
    return status;
}

void kiln_shares_end(struct kiln_shares *shares) { kiln_node_parts_destroy(&shares->parts[OF_WORK]); }

void kiln_shares_destroy(struct kiln_shares **shares)
{
    struct kiln_shares *s = *shares;
    if (s == NULL)
        return;
    for (int place = PLACES - 1; place >= 0; place--)
        kiln_node_parts_destroy(&s->parts[place]);
    kiln_free(&s->share);
    kiln_free(shares);
}

int kiln_shares_count(const struct kiln_shares *shares) { return shares->count; }
int kiln_shares_own(const struct kiln_shares *shares) { return shares->own; }
const struct kiln_share *kiln_share(const struct kiln_shares *shares, int index) { return &shares->share[index]; }
