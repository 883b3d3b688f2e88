#include "coordinator/view/leaf_light.h"

#include <math.h>
#include <string.h>

#include "coordinator/field/field.h"
#include "coordinator/output/read/rows.h"
#include "worker/sampling/keys.h"
#include "worker/base/memory.h"
#include "worker/scene/leaves.h"
#include "worker/store/store.h"

#define SIDE "/points/side"

struct kiln_leaf_light {
    struct kiln_image *image;
    const float *leaf[3], *object, *facing, *side, *valid, *rgb[3];
    uint32_t *slots; /* number of a leaf, and 1; 0: empty */
    uint32_t last;   /* slots, a power of two, less 1 */
};

/* Key of a leaf. All numbers are below 2^24, which floats hold. */
struct key {
    float leaf[3], object, facing, side;
};

static uint32_t begin_of(const struct kiln_leaf_light *l, const struct key *k)
{
    const uint32_t place = kiln_hash2((uint32_t)k->leaf[0], kiln_hash2((uint32_t)k->leaf[1], (uint32_t)k->leaf[2]));
    return kiln_hash2(place, kiln_hash2((uint32_t)k->object, (uint32_t)(2.0f * k->facing + k->side))) & l->last;
}

static struct key key_of(const struct kiln_leaf_light *l, uint32_t i)
{
    return (struct key){
        {l->leaf[0][i], l->leaf[1][i], l->leaf[2][i]}, l->object[i], l->facing[i], l->side != NULL ? l->side[i] : 0.0f};
}

static bool is_at(const struct kiln_leaf_light *l, uint32_t i, const struct key *k)
{
    const struct key own = key_of(l, i);
    const float off = fabsf(own.leaf[0] - k->leaf[0]) + fabsf(own.leaf[1] - k->leaf[1]) +
                      fabsf(own.leaf[2] - k->leaf[2]) + fabsf(own.object - k->object) + fabsf(own.facing - k->facing) +
                      fabsf(own.side - k->side);
    return !(off > 0.0f);
}

/* Returns the hash table slot of a leaf, or the empty slot for it. */
static uint32_t *slot_of(const struct kiln_leaf_light *l, const struct key *k)
{
    uint32_t i = begin_of(l, k);
    while (l->slots[i] != 0 && !is_at(l, l->slots[i] - 1, k))
        i = (i + 1) & l->last;
    return &l->slots[i];
}

static bool is_key(const float *values, uint32_t count)
{
    for (uint32_t i = 0; values != NULL && i < count; i++)
        if (!(values[i] >= 0.0f && values[i] <= 0x1p24f))
            return false;
    return values != NULL;
}

/* Finds the channels; false: a channel has a value that is impossible for leaves. */
static bool find_channels(struct kiln_leaf_light *l, const char *dataset)
{
    const uint32_t count = l->image->width;
    bool good = true;
    for (unsigned c = 0; c < 3; c++) {
        const float *values = kiln_dataset_of(l->image, dataset, c);
        l->rgb[c] = values == NULL && c > 0 ? l->rgb[c - 1] : values; /* one or two components: repeat the last one */
        l->leaf[c] = kiln_dataset_of(l->image, "/points/leaf", c);
        good = good && l->rgb[c] != NULL && is_key(l->leaf[c], count);
    }
    l->facing = kiln_dataset_of(l->image, "/points/facing", 0);
    l->object = kiln_dataset_of(l->image, "/points/object", 0);
    l->valid = kiln_dataset_of(l->image, "/points/valid", 0);
    l->side = kiln_dataset_of(l->image, SIDE, 0);
    return good && is_key(l->facing, count) && is_key(l->object, count) && is_key(l->valid, count) &&
           (l->side == NULL || is_key(l->side, count));
}

static int fill_slots(struct kiln_leaf_light *l, struct kiln_error *error)
{
    l->last = 1;
    while (l->last / 2 < l->image->width)
        l->last = 2 * l->last + 1;
    const int status = kiln_allocate(&l->slots, (size_t)l->last + 1, sizeof *l->slots, "an octree's leaves", error);
    for (uint32_t i = 0; status == KILN_OK && i < l->image->width; i++) {
        const struct key key = key_of(l, i);
        uint32_t *slot = slot_of(l, &key);
        if (*slot == 0)
            *slot = i + 1;
    }
    return status;
}

/* Reads the light and the keys of leaves. Only bakes with backs tell which leaves belong to backs. */
static int read_leaves(const struct kiln_view_source *source, const char *light, struct kiln_image **image,
                       struct kiln_error *error)
{
    enum { WITHOUT_SIDE = 5 };
    const char *const datasets[WITHOUT_SIDE + 1] = {
        light, "/points/leaf", "/points/facing", "/points/object", "/points/valid", SIDE};
    const int status = kiln_results_image(source->results, "kiln.h5", datasets, WITHOUT_SIDE + 1, image, error);
    return status == KILN_NO_INPUT
               ? kiln_results_image(source->results, "kiln.h5", datasets, WITHOUT_SIDE, image, error)
               : status;
}

int kiln_leaf_light_create(struct kiln_leaf_light **leaves, const struct kiln_view_source *source,
                           struct kiln_error *error)
{
    const char *const light = source->field != NULL ? source->field->dataset : "/irradiance/total";
    int status;
    KILN_TRY(kiln_allocate(leaves, 1, sizeof **leaves, "an octree's leaves", error));
    KILN_TRY(read_leaves(source, light, &(*leaves)->image, error));
    if (!find_channels(*leaves, light))
        KILN_TRY(kiln_fail(error, KILN_BAD_INPUT, "'%s/kiln.h5' does not have the leaves of an octree; bake again",
                           source->directory));
    KILN_TRY(fill_slots(*leaves, error));
end:
    if (status != KILN_OK)
        kiln_leaf_light_destroy(leaves);
    return status;
}

void kiln_leaf_light_destroy(struct kiln_leaf_light **leaves)
{
    if (*leaves == NULL)
        return;
    kiln_image_destroy(&(*leaves)->image);
    kiln_free(&(*leaves)->slots);
    kiln_free(leaves);
}

/* Position of a hit in the grid of leaves, along the world's axes. */
static void place_of(const struct kiln_geometry *g, const struct kiln_hit *hit, float place[3])
{
    const struct kiln_hit_record *record = &g->records[hit->triangle];
    const struct kiln_leaf_record *leaf = &g->leaves[hit->triangle];
    place[kiln_leaf_axis(leaf->side, 0)] = kiln_hit_x(record, hit->u, hit->v);
    place[kiln_leaf_axis(leaf->side, 1)] = kiln_hit_y(record, hit->u, hit->v);
    place[kiln_leaf_axis(leaf->side, 2)] =
        kiln_texel_coordinate(leaf->depth[0], leaf->depth[1], leaf->depth[2], hit->u, hit->v);
}

bool kiln_leaf_light_in(const struct kiln_leaf_light *l, const struct kiln_geometry *g, const struct kiln_hit *hit,
                        float rgb[3])
{
    struct key key = {.object = (float)g->records[hit->triangle].object,
                      .facing = (float)g->leaves[hit->triangle].side};
    float place[3];
    place_of(g, hit, place);
    for (int a = 0; a < 3; a++)
        key.leaf[a] = (float)kiln_leaf_of(place[a]);
    const uint32_t at = *slot_of(l, &key);
    for (int c = 0; c < 3; c++)
        rgb[c] = at != 0 ? l->rgb[c][at - 1] : 0.0f;
    return at != 0 && l->valid[at - 1] > 0.0f;
}

bool kiln_leaf_light_same(const struct kiln_leaf_light *a, const struct kiln_leaf_light *b, bool light)
{
    const float *const of_a[] = {a->leaf[0], a->leaf[1], a->leaf[2], a->object, a->facing,
                                 a->side,    a->valid,   a->rgb[0],  a->rgb[1], a->rgb[2]},
                       *const of_b[] = {b->leaf[0], b->leaf[1], b->leaf[2], b->object, b->facing,
                                        b->side,    b->valid,   b->rgb[0],  b->rgb[1], b->rgb[2]};
    const int count = light ? 10 : 6;
    bool same = a->image->width == b->image->width;
    for (int i = 0; same && i < count; i++)
        same = (of_a[i] == NULL) == (of_b[i] == NULL) &&
               (of_a[i] == NULL || memcmp(of_a[i], of_b[i], a->image->width * sizeof(float)) == 0);
    return same;
}

bool kiln_leaf_light_at(const struct kiln_leaf_light *l, const struct kiln_geometry *g, const struct kiln_hit *hit,
                        bool back, float rgb[3])
{
    const struct kiln_hit_record *record = &g->records[hit->triangle];
    const struct kiln_leaf_record *leaf = &g->leaves[hit->triangle];
    float own[3];
    place_of(g, hit, own);
    float low[3], part[3], sum = 0.0f, value[3] = {0.0f, 0.0f, 0.0f};
    for (int a = 0; a < 3; a++) {
        low[a] = floorf(own[a] - 0.5f);
        part[a] = own[a] - 0.5f - low[a];
    }
    for (uint32_t i = 0; i < 8; i++) {
        struct key key = {.object = (float)record->object,
                          .facing = (float)(back ? leaf->side ^ 1u : leaf->side),
                          .side = back ? 1.0f : 0.0f};
        float weight = 1.0f;
        bool inside = true;
        for (uint32_t a = 0; a < 3; a++) {
            const uint32_t up = i >> a & 1u;
            key.leaf[a] = low[a] + (float)up;
            weight *= up != 0 ? part[a] : 1.0f - part[a];
            inside = inside && key.leaf[a] >= 0.0f;
        }
        const uint32_t at = inside ? *slot_of(l, &key) : 0;
        if (at == 0 || !(l->valid[at - 1] > 0.0f))
            continue;
        sum += weight;
        for (int c = 0; c < 3; c++)
            value[c] += weight * l->rgb[c][at - 1];
    }
    for (int c = 0; c < 3; c++)
        rgb[c] = sum > 0.0f ? value[c] / sum : 0.0f;
    return sum > 0.0f;
}
