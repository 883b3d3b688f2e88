#include "coordinator/integrate/patches/directions.h"

#include <math.h>
#include <string.h>

#include "worker/base/color.h"
#include "worker/base/memory.h"
#include "worker/sampling/keys.h"
#include "worker/scene/radiosity.h"

/* Number of texels in a cluster: a square of 4 x 4. Bits of a tile are in Morton order, so each aligned run of 16 bits
 * is a square. */
enum { CLUSTER = 16 };
#define FLAT 0.9999f /* least cosine between normals of a flat cluster */

struct kiln_directions {
    struct kiln_directions_source source;
    struct kiln_direction *set;
    uint64_t *emission; /* packed */
    uint32_t *cluster_of, *members;
    float *power;
    struct kiln_bright_cluster *clusters;
    size_t cluster_room;
    struct kiln_bright bright;
    struct kiln_directions_parameters parameters;
};

uint64_t kiln_directions_bytes(const struct kiln_patch_settings *settings, uint64_t points)
{
    const uint64_t bright =
        settings->gather == KILN_GATHER_MIXED
            ? 2 * sizeof(uint32_t) + sizeof(float) + (sizeof(struct kiln_bright_cluster) + CLUSTER - 1) / CLUSTER
            : 0;
    return points * (bright + (settings->lights == KILN_LIGHTS_PATCHES ? sizeof(uint64_t) : 0));
}

void kiln_directions_destroy(struct kiln_directions **directions)
{
    struct kiln_directions *d = *directions;
    if (d != NULL) {
        kiln_free(&d->set);
        kiln_free(&d->emission);
        kiln_free(&d->cluster_of);
        kiln_free(&d->members);
        kiln_free(&d->power);
        kiln_free(&d->clusters);
    }
    kiln_free(directions);
}

/* ---- once ---- */

static int make_set(struct kiln_directions *d, uint32_t samples, struct kiln_error *error)
{
    const int gather = d->source.settings->gather;
    if (gather != KILN_GATHER_EVEN && gather != KILN_GATHER_CIRCLES)
        return KILN_OK;
    int status = kiln_allocate(&d->set, samples, sizeof *d->set, "a set of directions", error);
    if (status == KILN_OK && gather == KILN_GATHER_EVEN)
        kiln_directions_fibonacci(d->set, samples);
    else if (status == KILN_OK)
        status = kiln_directions_circles(d->set, samples, error);
    return status;
}

static int pack_emission(struct kiln_directions *d, struct kiln_error *error)
{
    const uint64_t points = d->source.surface->point_count;
    if (d->source.emission == NULL)
        return KILN_OK;
    const int status = kiln_allocate(&d->emission, (size_t)points, sizeof *d->emission, "what patches emit", error);
    for (uint64_t i = 0; i < points && status == KILN_OK; i++)
        d->emission[i] = kiln_radiosity_pack(d->source.emission[i], kiln_hash1(d->source.points[i].number));
    return status;
}

/* Computes position and normal of a cluster from its points, which are the last in the list of members. */
static void find_shape(struct kiln_directions *d, struct kiln_bright_cluster *c)
{
    const struct kiln_patch *points = d->source.points;
    double area = 0.0;
    for (uint32_t i = c->first; i < c->end; i++)
        area += (double)points[d->members[i]].area;
    for (uint32_t i = c->first; i < c->end; i++) { /* without any area all points have the same weight */
        const struct kiln_patch *p = &points[d->members[i]];
        const float share = area > 0.0 ? (float)((double)p->area / area) : 1.0f / (float)(c->end - c->first);
        c->centre = vec3_madd(c->centre, p->place, share);
        c->normal = vec3_madd(c->normal, p->normal, share);
    }
    c->is_flat = vec3_length(c->normal) > 0.0f;
    c->normal = c->is_flat ? vec3_normalize(c->normal) : vec3(0.0f, 0.0f, 1.0f);
    for (uint32_t i = c->first; i < c->end; i++) {
        const struct kiln_patch *p = &points[d->members[i]];
        const float half = 0.5f * (vec3_length(p->edge_s) + vec3_length(p->edge_t));
        c->radius = fmaxf(c->radius, vec3_length(vec3_sub(p->place, c->centre)) + half);
        c->is_flat = c->is_flat && vec3_dot(p->normal, c->normal) >= FLAT;
    }
}

/* Makes one cluster of points [first, end) of the members. */
static int add_cluster(struct kiln_directions *d, uint32_t first, uint32_t end, struct kiln_error *error)
{
    const int status = first < end ? kiln_grow(&d->clusters, &d->cluster_room, (size_t)d->bright.count + 1,
                                               sizeof *d->clusters, "clusters of patches", error)
                                   : KILN_OK;
    if (first == end || status != KILN_OK)
        return status;
    struct kiln_bright_cluster *c = &d->clusters[d->bright.count];
    *c = (struct kiln_bright_cluster){.first = first, .end = end};
    for (uint32_t i = first; i < end; i++)
        d->cluster_of[d->members[i]] = d->bright.count;
    find_shape(d, c);
    d->bright.count++;
    return KILN_OK;
}

/* Makes the clusters in the order of lightmap, tile and bit, which does not depend on cells and ranks. */
static int add_clusters(struct kiln_directions *d, struct kiln_error *error)
{
    const struct kiln_surface *s = d->source.surface;
    uint32_t count = 0;
    int status = KILN_OK;
    for (uint64_t t = 0; t < s->tile_count; t++)
        for (uint32_t bit = 0; bit < KILN_TILE_TEXELS && status == KILN_OK; bit += CLUSTER) {
            const uint32_t first = count;
            for (uint32_t i = bit; i < bit + CLUSTER; i++) {
                const uint64_t point = kiln_tile_point(s, &s->tiles[t], i).at;
                if (point != KILN_NO_POINT)
                    d->members[count++] = (uint32_t)point;
            }
            status = add_cluster(d, first, count, error);
        }
    return status;
}

static int make_clusters(struct kiln_directions *d, struct kiln_error *error)
{
    const size_t points = (size_t)d->source.surface->point_count;
    if (d->source.settings->gather != KILN_GATHER_MIXED)
        return KILN_OK;
    int status = kiln_allocate(&d->members, points, sizeof *d->members, "clusters of patches", error);
    if (status == KILN_OK)
        status = kiln_allocate(&d->cluster_of, points, sizeof *d->cluster_of, "clusters of patches", error);
    if (status == KILN_OK)
        status = kiln_allocate(&d->power, points, sizeof *d->power, "the power of patches", error);
    if (status != KILN_OK)
        return status;
    memset(d->cluster_of, 0xff, points * sizeof *d->cluster_of);
    status = add_clusters(d, error);
    d->bright.points = d->source.points;
    d->bright.cluster_of = d->cluster_of;
    d->bright.members = d->members;
    d->bright.power = d->power;
    d->bright.clusters = d->clusters;
    return status;
}

int kiln_directions_create(struct kiln_directions **directions, const struct kiln_directions_source *source,
                           uint32_t samples, struct kiln_error *error)
{
    struct kiln_directions *d = NULL;
    int status = kiln_allocate(&d, 1, sizeof *d, "the directions", error);
    *directions = d;
    if (status != KILN_OK)
        return status;
    d->source = *source;
    d->parameters.set_count = samples;
    KILN_TRY(make_set(d, samples, error));
    KILN_TRY(pack_emission(d, error));
    KILN_TRY(make_clusters(d, error));
end:
    if (status != KILN_OK)
        kiln_directions_destroy(directions);
    return status;
}

/* ---- a step ---- */

static double luminance_of(const uint64_t *radiosity, uint64_t point)
{
    float rgb[3];
    kiln_radiosity_unpack(radiosity[point], rgb);
    return kiln_luminance_of_floats(rgb);
}

/* Computes the bright clusters. Sums are in the order of members, which is the same on all ranks. */
static void find_bright(struct kiln_directions *d, const uint64_t *radiosity)
{
    struct kiln_bright *b = &d->bright;
    const struct kiln_patch *points = d->source.points;
    const uint32_t count = b->count > 0 ? d->clusters[b->count - 1].end : 0;
    double area = 0.0, power = 0.0, bright = 0.0;
    for (uint32_t i = 0; i < count; i++) {
        area += (double)points[d->members[i]].area;
        power += (double)points[d->members[i]].area * luminance_of(radiosity, d->members[i]);
    }
    const double mean = area > 0.0 ? power / area : 0.0;
    for (uint32_t k = 0; k < b->count; k++) {
        struct kiln_bright_cluster *c = &d->clusters[k];
        c->power = 0.0;
        for (uint32_t i = c->first; i < c->end; i++) {
            const uint32_t point = d->members[i];
            d->power[point] = points[point].area * (float)fmax(0.0, luminance_of(radiosity, point) - mean);
            c->power += (double)d->power[point];
        }
        bright += c->power;
    }
    b->rest = area > 0.0 ? (power - bright) / area : 0.0;
}

const struct kiln_directions_parameters *kiln_directions_update(struct kiln_directions *d, const uint64_t *radiosity,
                                                                bool of_emission)
{
    const uint64_t *light = of_emission ? d->emission : radiosity;
    if (d->members != NULL)
        find_bright(d, light);
    d->parameters.set = d->set;
    d->parameters.bright = d->members != NULL ? &d->bright : NULL;
    d->parameters.radiosity = of_emission ? d->emission : NULL;
    d->parameters.scale = of_emission ? 1.0 : d->source.settings->albedo_scale;
    return &d->parameters;
}
