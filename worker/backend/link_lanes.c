#include "worker/backend/link_lanes.h"

#include "worker/base/clones.h"

#define NEAREST 1.5       /* least distance of a linked node, in radii */
#define VARIES 8.0        /* allowed error when links are refined, over rho x the deviation of a node's light */
#define LEAST_FACTOR 1e-3 /* least factor of a node, over the square of the error; smaller ones are left out */
#define FLAT 1e-5         /* what of a cosine is rounding */

enum { GROUP = 8 }; /* lanes tested together, if any of them is wanted */

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

/* Decides whether a point links to a node, opens it or leaves it out; without branches, for SIMD lanes. */
static inline void judge(const struct kiln_link_node_view *v, const struct kiln_link_node *node, double square_error,
                         uint64_t *open, uint64_t *stands, uint64_t *whole)
{
    const double radius = (double)node->radius, high = v->height * v->inverse, reaches = v->reach * v->inverse,
                 factor = (double)node->area * (high < 1.0 ? high : 1.0) * (reaches < 1.0 ? reaches : 1.0) *
                          (1.0 / KILN_PI) * v->inverse * v->inverse,
                 rho = radius * v->inverse, turned = 2.0 * rho * (double)node->bend,
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
            const struct kiln_link_node_view v =
                kiln_link_node_view_of(node, lane_of(lanes->n, first + l), lane_of(lanes->at, first + l));
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
            const struct kiln_link_node_view v = kiln_link_node_view_of(node, n, lane_of(lanes->at, first + l));
            whole[l] = v.whole;
            f->inverse[first + l] = v.inverse;
            f->factor[first + l] = f->shading[first + l] = kiln_link_node_factor(node, n, &v);
            set_lane(f->slope, first + l, kiln_link_node_slope(node, n, &v));
        }
        for (uint32_t l = 0; lanes->smooth && l < GROUP; l++) {
            const struct kiln_dvec3 s = lane_of(lanes->s, first + l);
            const struct kiln_link_node_view v =
                kiln_link_node_view_of(node, lane_of(lanes->n, first + l), lane_of(lanes->at, first + l));
            f->shading[first + l] = kiln_link_node_factor(node, s, &v);
            set_lane(f->shading_slope, first + l, kiln_link_node_slope(node, s, &v));
        }
        f->whole |= bits_of(whole, first);
    }
    f->whole &= mask;
}

/* Converts a group's mask bits to numbers 1 and 0. */
static inline void numbers_of(uint64_t bits, double is[GROUP])
{
    for (uint32_t l = 0; l < GROUP; l++)
        is[l] = (bits >> l & 1) != 0 ? 1.0 : 0.0;
}

/* Flags of a group's lanes: 1 or 0. */
struct group {
    double seen[GROUP], any[GROUP], whole[GROUP];
};

/* Adds one colour of light that arrives in a group's lanes: F B; if a node is seen whole, also the slope of F times the
 * moment of B. The sum is clamped to 0. */
static inline void add_light(double *restrict sum, const double *restrict factor, const double *restrict slope,
                             const double *restrict light, const struct kiln_link_lane_link *restrict link, int c,
                             const struct group *restrict g)
{
    const double m[3] = {link->moment[c][0], link->moment[c][1], link->moment[c][2]}, filter = link->filter[c],
                 mean = link->light[c];
#pragma omp simd
    for (uint32_t l = 0; l < GROUP; l++) {
        const double along =
                         slope[l] * m[0] + slope[KILN_TILE_TEXELS + l] * m[1] + slope[2 * KILN_TILE_TEXELS + l] * m[2],
                     of_node = factor[l] * mean + along, of_point = factor[l] * light[l],
                     arrives = g->whole[l] > 0.0 ? of_node : of_point, some = arrives > 0.0 ? arrives : 0.0;
        sum[l] += g->seen[l] > 0.0 ? filter * some : 0.0;
    }
}

/* Adds rows and errors. */
static inline void add_error(double *restrict row, double *restrict variance, double *restrict now,
                             const double *restrict factor, const double *restrict about,
                             const double *restrict inverse, const struct kiln_link_lane_link *restrict link,
                             const double *restrict unsure, const struct group *restrict g)
{
    const double of_part = link->reach > 0.0 ? link->square : 0.0, /* if partly visible, or of a point */
        reach = link->reach, more = link->more, through = link->through, square = link->square,
                 light = through * link->now;
#pragma omp simd
    for (uint32_t l = 0; l < GROUP; l++) {
        const bool is_seen = g->seen[l] > 0.0;
        const double stated = is_seen ? about[l] : factor[l], rho = reach * inverse[l], spread = rho * rho * more,
                     off = g->whole[l] > 0.0 ? spread : of_part, all = unsure[l] * square + (is_seen ? off : 0.0),
                     varies = stated * stated * all;
        row[l] += is_seen ? factor[l] * through : 0.0;
        variance[l] += g->any[l] > 0.0 ? varies : 0.0;
        now[l] += is_seen ? stated * light : 0.0;
    }
}

KILN_CLONES void kiln_link_lanes_add(struct kiln_link_lane_sums *restrict s,
                                     const struct kiln_link_lane_factors *restrict f,
                                     const struct kiln_link_lane_link *restrict link)
{
    const double *about = link->by_first ? f->factor : f->shading;
    for (uint32_t i = 0; i < KILN_TILE_TEXELS; i += GROUP) {
        const uint64_t all = link->sees | link->other;
        struct group g;
        if ((all >> i & ((1u << GROUP) - 1)) == 0)
            continue;
        numbers_of(link->sees >> i, g.seen);
        numbers_of(all >> i, g.any);
        numbers_of(f->whole >> i, g.whole);
        add_error(&s->row[i], &s->variance[i], &s->now[i], &f->factor[i], &about[i], &f->inverse[i], link,
                  &link->unsure[i], &g);
        for (int c = 0; c < 3; c++) {
            add_light(&s->incident[c][i], &f->factor[i], &f->slope[0][i], &f->light[c][i], link, c, &g);
            if (link->smooth)
                add_light(&s->irradiance[c][i], &f->shading[i], &f->shading_slope[0][i], &f->light[c][i], link, c, &g);
        }
    }
}
