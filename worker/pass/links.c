#include "worker/pass/links.h"

#include <math.h>
#include <string.h>

#include "worker/base/memory.h"

/* Encoding of a tile run's links: flags; numbers of links and of tinted ones; for each point its ray statistics, and
 * perhaps its shading normal; then the links. Numbers have seven bits per byte; the highest bit tells that more bytes
 * follow. Each link begins with a number: its target, as the difference to the node or point of the previous link, and
 * two bits that tell which masks follow. The mask of points that have asked follows if it differs from the previous
 * link's, as the XOR of both; the mask of points that see the target follows if not all of these do. A mask is a byte
 * with a bit for each of its bytes that is not 0, followed by these bytes. */
#define SAMPLES 0.4 /* samples of a net; their error is proportional to their number ^ (-3/4) (Mitchell 1996) */
enum { LEAST_SAMPLES = 16 };
#define SHARED 0.7 /* radii of a node; grows with the squared error where that is above SHARED_AT */
#define SHARED_AT 0.02
enum { HAS_GLASS = 1, HAS_PRESENT = 2, IS_SMOOTH = 4, OPENED_SHIFT = 3 }; /* of the flags' byte */
enum { TO_LEAF = 1, OTHERS_ASKED = 2, SOME_SEEN = 4, STEP_SHIFT = 3 };

double kiln_links_shared(double error)
{
    const double coarse = error / SHARED_AT;
    return SHARED * (coarse > 1.0 ? coarse * coarse : 1.0);
}

uint32_t kiln_links_samples(double error, uint32_t samples)
{
    uint32_t wanted = LEAST_SAMPLES;
    while (wanted < samples && (double)wanted < SAMPLES * pow(error, -4.0 / 3.0))
        wanted *= 2;
    return wanted < samples ? wanted : samples;
}

void kiln_found_links_release(struct kiln_found_links *f)
{
    kiln_free(&f->to);
    kiln_free(&f->asked);
    kiln_free(&f->seen);
    kiln_free(&f->tinted);
    *f = (struct kiln_found_links){0};
}

int kiln_found_links_reserve(struct kiln_found_links *f, size_t count, struct kiln_error *error)
{
    static const char what[] = "the links of a tile";
    int status;
    KILN_TRY(kiln_grow(&f->to, &f->room_to, count, sizeof *f->to, what, error));
    KILN_TRY(kiln_grow(&f->asked, &f->room_asked, count, sizeof *f->asked, what, error));
    KILN_TRY(kiln_grow(&f->seen, &f->room_seen, count, sizeof *f->seen, what, error));
end:
    return status;
}

int kiln_found_links_reserve_tinted(struct kiln_found_links *f, size_t count, struct kiln_error *error)
{
    return kiln_grow(&f->tinted, &f->room_tinted, count, sizeof *f->tinted, "tinted links", error);
}

uint64_t kiln_links_bytes(const struct kiln_kept_links *l) { return sizeof *l + l->bytes; }

/* ---- writing ---- */

/* Writer of an encoding, which grows; status: whether memory sufficed. */
struct writer {
    uint8_t *code;
    size_t size, room;
    int status;
    struct kiln_error *error;
};

static void put(struct writer *w, const void *data, size_t bytes)
{
    if (w->status == KILN_OK)
        w->status = kiln_grow(&w->code, &w->room, w->size + bytes, 1, "the links of a tile", w->error);
    if (w->status == KILN_OK && bytes > 0)
        memcpy(w->code + w->size, data, bytes);
    w->size += bytes;
}

static void put_number(struct writer *w, uint64_t number)
{
    uint8_t bytes[10];
    size_t count = 0;
    for (; number >= 128; number >>= 7)
        bytes[count++] = (uint8_t)(number | 128);
    bytes[count++] = (uint8_t)number;
    put(w, bytes, count);
}

static void put_mask(struct writer *w, uint64_t mask)
{
    uint8_t bytes[9] = {0};
    size_t count = 1;
    for (uint32_t i = 0; i < 8; i++)
        if ((mask >> 8 * i & 255) != 0) {
            bytes[0] = (uint8_t)(bytes[0] | 1u << i);
            bytes[count++] = (uint8_t)(mask >> 8 * i);
        }
    put(w, bytes, count);
}

static uint8_t flags_of(const struct kiln_found_links *f, uint64_t mask)
{
    bool glass = false, present = false;
    for (uint64_t rest = mask; rest != 0; rest &= rest - 1) {
        const struct kiln_linked_point *p = &f->point[__builtin_ctzll(rest)];
        glass = glass || p->glass[0] != 0.0f || p->glass[1] != 0.0f || p->glass[2] != 0.0f;
        present = present || (p->count > 0 && p->present != 1.0f);
    }
    return (uint8_t)((glass ? HAS_GLASS : 0) | (present ? HAS_PRESENT : 0) | (f->smooth ? IS_SMOOTH : 0) |
                     (int)(f->opened << OPENED_SHIFT));
}

static void put_point(struct writer *w, const struct kiln_found_links *f, uint32_t bit, uint8_t flags)
{
    const struct kiln_linked_point *p = &f->point[bit];
    put_number(w, p->count);
    if (p->count == 0)
        return;
    put(w, &p->scale, sizeof p->scale);
    put(w, &p->escaped, sizeof p->escaped);
    put(w, &p->blocked, sizeof p->blocked);
    if ((flags & HAS_GLASS) != 0)
        put(w, p->glass, sizeof p->glass);
    if ((flags & HAS_PRESENT) != 0)
        put(w, &p->present, sizeof p->present);
    if ((flags & IS_SMOOTH) != 0)
        put(w, f->shading[bit], sizeof f->shading[bit]);
}

/* The points that have light. */
static uint64_t lit_of(const struct kiln_found_links *f, uint64_t mask)
{
    uint64_t lit = 0;
    for (uint64_t rest = mask; rest != 0; rest &= rest - 1)
        if (f->point[__builtin_ctzll(rest)].count > 0)
            lit |= rest & -rest;
    return lit;
}

static void put_links(struct writer *w, const struct kiln_found_links *f, uint64_t all)
{
    uint32_t last[2] = {0, 0};
    uint64_t asked = all;
    for (uint32_t i = 0; i < f->count; i++) {
        const uint32_t leaf = (f->to[i] & KILN_LINK_LEAF) != 0, at = f->to[i] & ~KILN_LINK_LEAF;
        const bool others_asked = f->asked[i] != asked, some_seen = f->seen[i] != f->asked[i];
        const uint64_t flags =
            (leaf ? TO_LEAF : 0u) | (others_asked ? OTHERS_ASKED : 0u) | (some_seen ? (unsigned)SOME_SEEN : 0u);
        put_number(w, (uint64_t)(at - last[leaf]) << STEP_SHIFT | flags);
        last[leaf] = at;
        if (others_asked)
            put_mask(w, f->asked[i] ^ asked);
        asked = f->asked[i];
        if (some_seen)
            put_mask(w, f->seen[i]);
    }
    for (uint32_t i = 0; i < f->tinted_count; i++)
        put(w, &f->tinted[i], sizeof f->tinted[i]);
}

int kiln_links_encode(struct kiln_kept_links **kept, const struct kiln_found_links *f, uint64_t first, uint64_t mask,
                      uint64_t shares, struct kiln_error *error)
{
    struct writer w = {.error = error};
    struct kiln_kept_links head = {.first = first, .points = (uint32_t)__builtin_popcountll(mask)};
    const uint8_t flags = flags_of(f, mask);
    put(&w, &head, sizeof head);
    put(&w, &flags, 1);
    put_number(&w, f->count);
    put_number(&w, f->tinted_count);
    for (uint64_t rest = mask; rest != 0; rest &= rest - 1)
        put_point(&w, f, (uint32_t)__builtin_ctzll(rest), flags);
    put_links(&w, f, lit_of(f, mask) | shares);
    *kept = NULL;
    if (w.status == KILN_OK)
        w.status = kiln_allocate(kept, w.size, 1, "the links of a tile", error);
    if (w.status == KILN_OK) {
        head.bytes = (uint32_t)(w.size - sizeof head);
        head.links = f->tinted_count;
        for (uint32_t i = 0; i < f->count; i++)
            head.links += (uint32_t)__builtin_popcountll(f->seen[i] & mask);
        memcpy(*kept, w.code, w.size);
        **kept = head;
    }
    kiln_free(&w.code);
    return w.status;
}

/* ---- reading ---- */

/* Rest of an encoding to read; bad: it ended too early. */
struct reader {
    const uint8_t *at;
    size_t left;
    bool bad;
};

static void get(struct reader *r, void *to, size_t bytes)
{
    r->bad = r->bad || bytes > r->left;
    if (r->bad) {
        memset(to, 0, bytes);
        return;
    }
    memcpy(to, r->at, bytes);
    r->at += bytes;
    r->left -= bytes;
}

static uint64_t get_number(struct reader *r)
{
    uint64_t number = 0;
    uint8_t byte = 128;
    for (uint32_t shift = 0; shift < 64 && byte >= 128; shift += 7) {
        get(r, &byte, 1);
        number |= (uint64_t)(byte & 127) << shift;
    }
    r->bad = r->bad || byte >= 128;
    return number;
}

static uint64_t get_mask(struct reader *r)
{
    uint8_t there, byte;
    uint64_t mask = 0;
    get(r, &there, 1);
    for (uint32_t i = 0; i < 8; i++)
        if ((there >> i & 1) != 0) {
            get(r, &byte, 1);
            mask |= (uint64_t)byte << 8 * i;
        }
    return mask;
}

/* `shading`: set where the code has it. */
static void get_point(struct reader *r, struct kiln_linked_point *p, float shading[3], uint8_t flags)
{
    *p = (struct kiln_linked_point){.present = 1.0f};
    p->count = (uint32_t)get_number(r);
    if (p->count == 0)
        return;
    get(r, &p->scale, sizeof p->scale);
    get(r, &p->escaped, sizeof p->escaped);
    get(r, &p->blocked, sizeof p->blocked);
    if ((flags & HAS_GLASS) != 0)
        get(r, p->glass, sizeof p->glass);
    if ((flags & HAS_PRESENT) != 0)
        get(r, &p->present, sizeof p->present);
    if ((flags & IS_SMOOTH) != 0)
        get(r, shading, 3 * sizeof *shading);
}

static void get_tinted(struct reader *r, struct kiln_tinted_link *t, uint64_t all, const uint64_t most[2])
{
    get(r, t, sizeof *t);
    r->bad = r->bad || t->bit >= KILN_TILE_TEXELS || (all >> t->bit & 1) == 0 ||
             (t->to & ~KILN_LINK_LEAF) >= most[(t->to & KILN_LINK_LEAF) != 0];
}

static void get_links(struct reader *r, struct kiln_found_links *f, uint64_t all, const uint64_t most[2])
{
    uint64_t last[2] = {0, 0}, asked = all;
    for (uint32_t i = 0; i < f->count && !r->bad; i++) {
        const uint64_t code = get_number(r), leaf = code & TO_LEAF;
        last[leaf] += code >> STEP_SHIFT;
        asked ^= (code & OTHERS_ASKED) != 0 ? get_mask(r) : 0;
        f->asked[i] = asked;
        f->seen[i] = (code & SOME_SEEN) != 0 ? get_mask(r) : f->asked[i];
        r->bad = r->bad || last[leaf] >= most[leaf] || (f->asked[i] & ~all) != 0 || (f->seen[i] & ~f->asked[i]) != 0;
        f->to[i] = (uint32_t)last[leaf] | (leaf != 0 ? KILN_LINK_LEAF : 0);
    }
    for (uint32_t i = 0; i < f->tinted_count && !r->bad; i++)
        get_tinted(r, &f->tinted[i], all, most);
}

static int say_damaged(const struct kiln_kept_links *kept, struct kiln_error *error)
{
    return kiln_fail(error, KILN_BAD_INPUT, "the links of the surface points from %llu on are damaged",
                     (unsigned long long)kept->first);
}

/* Reads the flags, and the numbers of links. */
static uint8_t get_head(struct reader *r, const struct kiln_kept_links *kept, uint64_t *count, uint64_t *tinted)
{
    uint8_t flags;
    get(r, &flags, 1);
    *count = get_number(r);
    *tinted = get_number(r);
    r->bad = r->bad || *count > kept->bytes || *tinted > kept->bytes;
    return flags;
}

uint32_t kiln_links_opened(const struct kiln_kept_links *kept)
{
    return kept->bytes > 0 ? (uint32_t)kept->code[0] >> OPENED_SHIFT : 0;
}

void kiln_links_replace(struct kiln_kept_links **kept, struct kiln_kept_links *made)
{
    if (*kept != NULL && kiln_links_opened(*kept) == kiln_links_opened(made))
        made->of_file = (*kept)->of_file;
    kiln_free(kept);
    *kept = made;
}

int kiln_links_head(const struct kiln_kept_links *kept, uint32_t *count, uint32_t *tinted, struct kiln_error *error)
{
    struct reader r = {kept->code, kept->bytes, false};
    uint64_t links, tints;
    (void)get_head(&r, kept, &links, &tints);
    *count = r.bad ? 0 : (uint32_t)links;
    *tinted = r.bad ? 0 : (uint32_t)tints;
    return r.bad ? say_damaged(kept, error) : KILN_OK;
}

int kiln_links_points(const struct kiln_kept_links *kept, uint64_t mask,
                      struct kiln_linked_point point[KILN_TILE_TEXELS], struct kiln_error *error)
{
    struct reader r = {kept->code, kept->bytes, kept->points != (uint32_t)__builtin_popcountll(mask)};
    uint64_t count, tinted;
    float shading[3];
    const uint8_t flags = get_head(&r, kept, &count, &tinted);
    for (uint64_t rest = mask; rest != 0 && !r.bad; rest &= rest - 1)
        get_point(&r, &point[__builtin_ctzll(rest)], shading, flags);
    return r.bad ? say_damaged(kept, error) : KILN_OK;
}

void kiln_links_close(struct kiln_kept_links *kept, uint64_t mask, const float scale[KILN_TILE_TEXELS],
                      const float shading[KILN_TILE_TEXELS][3])
{
    struct reader r = {kept->code, kept->bytes, false};
    uint64_t count, tinted;
    const uint8_t flags = get_head(&r, kept, &count, &tinted);
    for (uint64_t rest = mask; rest != 0; rest &= rest - 1) {
        const uint32_t bit = (uint32_t)__builtin_ctzll(rest);
        struct reader begin = r;
        struct kiln_linked_point point;
        float normal[3];
        get_point(&r, &point, normal, flags);
        if (point.count == 0)
            continue;
        (void)get_number(&begin);
        memcpy(kept->code + (begin.at - kept->code), &scale[bit], sizeof scale[bit]);
        if ((flags & IS_SMOOTH) != 0)
            memcpy(kept->code + (r.at - kept->code) - sizeof shading[bit], shading[bit], sizeof shading[bit]);
    }
}

/* ---- checking ---- */

#define MOST_RAYS 1e9f   /* limit of sums over a point's samples; light absorbed by mirrors and glass may be negative */
#define MOST_SCALE 1e18f /* limit of a row's scale, which is large for very short rows; light must stay finite */
#define MOST_TINT 1e3f
#define MOST_UNIT 1.01f /* of a part of a normal */

/* False for what is not finite, too. */
static bool are_within(const float *values, size_t count, float low, float high)
{
    bool within = true;
    for (size_t i = 0; i < count; i++)
        within = within && values[i] >= low && values[i] <= high;
    return within;
}

static void check_point(struct reader *r, uint8_t flags)
{
    struct kiln_linked_point p;
    float shading[3] = {0.0f, 0.0f, 0.0f};
    get_point(r, &p, shading, flags);
    r->bad = r->bad || !are_within(&p.scale, 1, 0.0f, MOST_SCALE) || !are_within(&p.escaped, 1, 0.0f, MOST_RAYS) ||
             !are_within(&p.blocked, 1, 0.0f, MOST_RAYS) || !are_within(p.glass, 3, -MOST_RAYS, MOST_RAYS) ||
             !are_within(&p.present, 1, 0.0f, 1.0f) || !are_within(shading, 3, -MOST_UNIT, MOST_UNIT);
}

int kiln_links_check(const struct kiln_kept_links *kept, uint64_t point_count, struct kiln_error *error)
{
    struct reader r = {kept->code, kept->bytes, kept->points > KILN_TILE_TEXELS};
    const uint64_t most[2] = {KILN_LINK_LEAF, point_count};
    uint64_t count, tinted, last[2] = {0, 0};
    const uint8_t flags = get_head(&r, kept, &count, &tinted);
    for (uint32_t i = 0; i < kept->points && !r.bad; i++)
        check_point(&r, flags);
    for (uint64_t i = 0; i < count && !r.bad; i++) {
        const uint64_t code = get_number(&r), leaf = code & TO_LEAF;
        last[leaf] += code >> STEP_SHIFT;
        if ((code & OTHERS_ASKED) != 0)
            (void)get_mask(&r);
        if ((code & SOME_SEEN) != 0)
            (void)get_mask(&r);
        r.bad = r.bad || last[leaf] >= most[leaf];
    }
    for (uint64_t i = 0; i < tinted && !r.bad; i++) {
        struct kiln_tinted_link link;
        get_tinted(&r, &link, UINT64_MAX, most);
        r.bad = r.bad || !are_within(link.through, 3, 0.0f, MOST_TINT);
    }
    return !r.bad && r.left == 0 ? KILN_OK : say_damaged(kept, error);
}

int kiln_links_decode(struct kiln_found_links *f, const struct kiln_kept_links *kept, uint64_t mask, uint64_t shares,
                      uint32_t node_count, uint64_t point_count, struct kiln_error *error)
{
    struct reader r = {kept->code, kept->bytes, kept->points != (uint32_t)__builtin_popcountll(mask)};
    const uint64_t most[2] = {node_count, point_count};
    uint64_t count, tinted;
    const uint8_t flags = get_head(&r, kept, &count, &tinted);
    f->smooth = (flags & IS_SMOOTH) != 0;
    f->opened = flags >> OPENED_SHIFT;
    int status = r.bad ? KILN_OK : kiln_found_links_reserve(f, count, error);
    if (status == KILN_OK && !r.bad)
        status = kiln_found_links_reserve_tinted(f, tinted, error);
    if (status != KILN_OK)
        return status;
    f->count = r.bad ? 0 : (uint32_t)count;
    f->tinted_count = r.bad ? 0 : (uint32_t)tinted;
    for (uint64_t rest = mask; rest != 0 && !r.bad; rest &= rest - 1)
        get_point(&r, &f->point[__builtin_ctzll(rest)], f->shading[__builtin_ctzll(rest)], flags);
    get_links(&r, f, lit_of(f, mask) | shares, most);
    return !r.bad && r.left == 0 ? KILN_OK : say_damaged(kept, error);
}
