#include "worker/backend/link_lanes.h"

#include "worker/base/clones.h"

#define NEAREST 1.5       /* radii from which a node may be linked to */
#define VARIES 8.0        /* of rho and the deviation of a node's light, what it may be off by when links are opened */
#define LEAST_FACTOR 1e-3 /* over the square of the error: nodes below are left out */
#define FLAT 1e-5         /* what of a cosine is rounding */

enum { GROUP = 8 }; /* lanes that are looked at together, if one of them is asked for */

static inline struct kiln_dvec3 lane_of(const double v[3][KILN_TILE_TEXELS], uint32_t lane)
{
    return dvec3(v[0][lane], v[1][lane], v[2][lane]);
}

static inline void set_lane(double v[3][KILN_TILE_TEXELS], uint32_t lane, struct kiln_dvec3 to)
{
    v[0][lane] = to.x, v[1][lane] = to.y, v[2][lane] = to.z;
}

/* Lanes from `first` on, as bits. */
static inline uint64_t bits_of(const uint64_t is[GROUP], uint32_t first)
{
    uint64_t bits = 0;
    for (uint32_t l = 0; l < GROUP; l++)
        bits |= is[l] << (first + l);
    return bits;
}

/* What one point does with a node; without branches, for lanes. */
static inline void judge(const struct kiln_node_view *v, const struct kiln_link_node *node, double square_error,
                         uint64_t *open, uint64_t *stands, uint64_t *whole)
{
    const double radius = (double)node->radius, high = v->height / v->distance, reaches = v->reach / v->distance,
                 factor = (double)node->area * (high < 1.0 ? high : 1.0) * (reaches < 1.0 ? reaches : 1.0) /
                          (KILN_PI * v->square),
                 rho = radius / v->distance, turned = 2.0 * rho * (double)node->bend,
                 spread = VARIES * rho * (double)node->spread, light = 1.0 + (double)node->level,
                 of_whole = KILN_LINKS_UNSEEN + turned * turned, unsure = v->whole ? of_whole : 1.0;
    const bool seen = (v->height > 0.0) & (v->reach > FLAT * (v->distance + radius)),
               near = v->distance < NEAREST * radius,
               small = factor<LEAST_FACTOR * square_error, large = factor * (unsure * light * light + spread * spread)>
                           square_error * light;
    *open = seen & (near | (!small & large));
    *stands = seen & !near & !small & !large;
    *whole = *stands & v->whole;
}

KILN_CLONES struct kiln_link_lane_choices kiln_link_lanes_judge(const struct kiln_link_lanes *lanes,
                                                                const struct kiln_link_node *node, double square_error,
                                                                uint64_t mask)
{
    struct kiln_link_lane_choices choices = {0, 0, 0};
    for (uint32_t first = 0; first < KILN_TILE_TEXELS; first += GROUP) {
        uint64_t open[GROUP], stands[GROUP], whole[GROUP];
        if ((mask >> first & ((1u << GROUP) - 1)) == 0)
            continue;
        for (uint32_t l = 0; l < GROUP; l++) {
            const struct kiln_node_view v =
                kiln_node_view_of(node, lane_of(lanes->n, first + l), lane_of(lanes->at, first + l));
            judge(&v, node, square_error, &open[l], &stands[l], &whole[l]);
        }
        choices.open |= bits_of(open, first);
        choices.stands |= bits_of(stands, first);
        choices.whole |= bits_of(whole, first);
    }
    return (struct kiln_link_lane_choices){choices.open & mask, choices.stands & mask, choices.whole & mask};
}

KILN_CLONES void kiln_link_lanes_factors(const struct kiln_link_lanes *lanes, const struct kiln_link_node *node,
                                         uint64_t mask, struct kiln_link_lane_factors *f)
{
    f->whole = 0;
    for (uint32_t first = 0; first < KILN_TILE_TEXELS; first += GROUP) {
        uint64_t whole[GROUP];
        if ((mask >> first & ((1u << GROUP) - 1)) == 0)
            continue;
        for (uint32_t l = 0; l < GROUP; l++) {
            const struct kiln_dvec3 n = lane_of(lanes->n, first + l);
            const struct kiln_node_view v = kiln_node_view_of(node, n, lane_of(lanes->at, first + l));
            whole[l] = v.whole;
            f->distance[first + l] = v.distance;
            f->factor[first + l] = f->shading[first + l] = kiln_node_factor(node, n, &v);
            set_lane(f->slope, first + l, kiln_node_slope(node, n, &v));
        }
        for (uint32_t l = 0; lanes->smooth && l < GROUP; l++) {
            const struct kiln_dvec3 s = lane_of(lanes->s, first + l);
            const struct kiln_node_view v =
                kiln_node_view_of(node, lane_of(lanes->n, first + l), lane_of(lanes->at, first + l));
            f->shading[first + l] = kiln_node_factor(node, s, &v);
            set_lane(f->shading_slope, first + l, kiln_node_slope(node, s, &v));
        }
        f->whole |= bits_of(whole, first);
    }
    f->whole &= mask;
}

/* What arrives from a node whose light varies: F B and the slope of F times the moment of B, which together never fall
 * below 0. */
static inline double arriving(double flat, double more)
{
    const double sum = flat + more, less = flat > 0.0 ? flat * (flat / (flat - more)) : 0.0;
    return more < 0.0 ? less : sum;
}

static inline double along(const double slope[3][KILN_TILE_TEXELS], uint32_t i, const double moment[3])
{
    return slope[0][i] * moment[0] + slope[1][i] * moment[1] + slope[2][i] * moment[2];
}

/* Adds a colour of the light that arrives in a lane. */
static inline void add_light(struct kiln_link_lane_sums *restrict s, const struct kiln_link_lane_factors *restrict f,
                             const struct kiln_link_lane_link *restrict link, int c, uint32_t i, bool is_seen,
                             bool is_whole)
{
    const double light = is_whole ? link->light[c] : f->light[c][i], filter = is_seen ? link->filter[c] : 0.0,
                 more = is_whole ? along(f->slope, i, link->moment[c]) : 0.0,
                 incident = filter * arriving(f->factor[i] * light, more);
    s->incident[c][i] += incident;
    if (!link->smooth) {
        s->irradiance[c][i] += incident;
        return;
    }
    const double about = is_whole ? along(f->shading_slope, i, link->moment[c]) : 0.0;
    s->irradiance[c][i] += filter * arriving(f->shading[i] * light, about);
}

KILN_CLONES void kiln_link_lanes_add(struct kiln_link_lane_sums *restrict s,
                                     const struct kiln_link_lane_factors *restrict f,
                                     const struct kiln_link_lane_link *restrict link)
{
    const bool by_first = link->by_first;
    const double of_part = link->reach > 0.0 ? link->square : 0.0; /* of what is seen in part, or of a point */
    for (uint32_t first = 0; first < KILN_TILE_TEXELS; first += GROUP) {
        const uint64_t sees = link->sees >> first, all = (link->sees | link->other) >> first, whole = f->whole >> first;
        if ((all & ((1u << GROUP) - 1)) == 0)
            continue;
        for (uint32_t l = 0; l < GROUP; l++) {
            const uint32_t i = first + l;
            const bool is_seen = (sees >> l & 1) != 0, is_any = (all >> l & 1) != 0, is_whole = (whole >> l & 1) != 0;
            const double own = f->factor[i], about = f->shading[i], either = by_first ? own : about,
                         factor = is_seen ? own : 0.0, stated = is_seen ? either : own,
                         rho = link->reach / f->distance[i], spread = rho * rho * link->more,
                         off = is_whole ? spread : of_part, unseen = link->unsure[i] * link->square,
                         square = unseen + (is_seen ? off : 0.0), variance = stated * stated * square,
                         now = stated * link->through * link->now;
            s->row[i] += factor * link->through;
            s->variance[i] += is_any ? variance : 0.0;
            s->now[i] += is_seen ? now : 0.0;
        }
        for (int c = 0; c < 3; c++)
            for (uint32_t l = 0; l < GROUP; l++)
                add_light(s, f, link, c, first + l, (sees >> l & 1) != 0, (whole >> l & 1) != 0);
    }
}
