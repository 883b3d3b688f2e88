#include "coordinator/view/view_guide.h"

#include <math.h>
#include <stdlib.h>

#include "coordinator/view/view.h"
#include "worker/base/memory.h"
#include "worker/sampling/keys.h"

/* Cells along the scene's longest side: CELLS of surfaces with gloss, FOUND_CELLS of found sources. REGIONS: number of
 * regions. Balls (sources) of a region: its own, and those of the whole picture. KEY: key of the random numbers. */
enum { CELLS = 6, FOUND_CELLS = 12, SIDES = 6, REGIONS = 512 * SIDES };
enum { OWN_BALLS = 12, ALL_BALLS = 6, MOST_BALLS = OWN_BALLS + ALL_BALLS, KEY = 0x67756964 };

/* most_guided: largest share of rays aimed at sources. left_to_all: share of these for sources of the whole picture.
 * wide: alpha from which lobes have the largest share. radius: of a ball, in cells. */
static const float most_guided = 0.5f, left_to_all = 0.25f, wide = 0.1f, radius = 0.75f;

struct kiln_view_source_ball {
    struct kiln_vec3 middle;
    float part; /* share of the rays aimed at sources; sums to 1 over a region */
};

/* Source found by a ray. */
struct lesson {
    uint32_t region, cell;
    struct kiln_vec3 found;
    float value;
};

struct kiln_view_guides {
    float longest; /* side of the scene, m */
    struct lesson *lessons;
    size_t count, capacity;
    struct region {
        struct kiln_view_source_ball balls[MOST_BALLS];
        uint32_t count;
        float differ; /* 0 to 1: share of the findings' second moment that their mean does not explain */
    } regions[REGIONS];
};

int kiln_view_guides_create(struct kiln_view_guides **guides, const struct kiln_geometry *geometry, size_t capacity,
                            struct kiln_error *error)
{
    int status = kiln_allocate(guides, 1, sizeof **guides, "guides of a view", error);
    if (status != KILN_OK)
        return status;
    const struct kiln_vec3 size = vec3_sub(geometry->bounds_max, geometry->bounds_min);
    (*guides)->longest = fmaxf(fmaxf(size.x, size.y), size.z);
    (*guides)->capacity = capacity;
    status = kiln_allocate(&(*guides)->lessons, capacity, sizeof *(*guides)->lessons, "guides of a view", error);
    if (status != KILN_OK)
        kiln_view_guides_destroy(guides);
    return status;
}

void kiln_view_guides_destroy(struct kiln_view_guides **guides)
{
    if (*guides == NULL)
        return;
    kiln_free(&(*guides)->lessons);
    kiln_free(guides);
}

/* ---- regions and cells ---- */

static struct kiln_particle_chance own_chance(const struct kiln_particle_chance *chance)
{
    return (struct kiln_particle_chance){
        .key = kiln_hash1(chance->key ^ KEY), .number = chance->number, .surface = chance->surface};
}

/* Hash of a cell, with `cells` cells along the longest side; `moved`: offset in cells. */
static uint32_t cell_of(const struct kiln_view_guides *g, int cells, struct kiln_vec3 p, struct kiln_dvec3 moved)
{
    const double each = (double)cells / (double)g->longest;
    const int32_t x = (int32_t)floor((double)p.x * each + moved.x), y = (int32_t)floor((double)p.y * each + moved.y),
                  z = (int32_t)floor((double)p.z * each + moved.z);
    return kiln_hash2(kiln_hash2((uint32_t)x, (uint32_t)y), (uint32_t)z);
}

uint32_t kiln_view_guides_region(const struct kiln_view_guides *guides, const struct kiln_particle_place *place,
                                 const struct kiln_particle_chance *chance)
{
    const struct kiln_particle_chance own = own_chance(chance);
    double x, y, z, rest;
    if (place->lobes.glass > 0.0f || kiln_particle_is_smooth(place) || !(guides->longest > 0.0f))
        return KILN_NONE;
    kiln_particle_draw(&own, KILN_PATH_LIGHT, &x, &y);
    kiln_particle_draw(&own, KILN_PATH_PICK, &z, &rest);
    const uint32_t cell = cell_of(guides, CELLS, place->position, dvec3(x, y, z));
    return cell % (REGIONS / SIDES) * SIDES + kiln_view_side(vec3_scale(place->normal, place->hit.back ? -1.0f : 1.0f));
}

/* ---- learning ---- */

float kiln_view_guides_far(const struct kiln_view_guides *guides) { return 2.0f * guides->longest; }

void kiln_view_guides_learn(struct kiln_view_guides *guides, uint32_t region, struct kiln_vec3 found, float value)
{
    if (region == KILN_NONE || guides->count == guides->capacity || !isfinite(value) || value < 0.0f)
        return;
    guides->lessons[guides->count++] = (struct lesson){
        .region = region, .cell = cell_of(guides, FOUND_CELLS, found, dvec3(0, 0, 0)), .found = found, .value = value};
}

static int compare_u32(uint32_t a, uint32_t b) { return (a > b) - (a < b); }
static int compare_floats(float a, float b) { return (a > b) - (a < b); }

/* Orders lessons by region and cell; then by all other members, so that sums have a fixed order. */
static int compare_lessons(const void *a, const void *b)
{
    const struct lesson *p = a, *q = b;
    const int by[] = {compare_u32(p->region, q->region),      compare_u32(p->cell, q->cell),
                      compare_floats(p->value, q->value),     compare_floats(p->found.x, q->found.x),
                      compare_floats(p->found.y, q->found.y), compare_floats(p->found.z, q->found.z)};
    for (size_t i = 0; i < sizeof by / sizeof *by; i++)
        if (by[i] != 0)
            return by[i];
    return 0;
}

/* Inserts a ball into the region's list, which is sorted by descending part, if there is room or a smaller ball. */
static void keep(struct region *r, uint32_t most, struct kiln_view_source_ball ball)
{
    uint32_t at = r->count < most ? r->count++ : most;
    for (; at > 0 && ball.part > r->balls[at - 1].part; at--)
        if (at < most)
            r->balls[at] = r->balls[at - 1];
    if (at < most)
        r->balls[at] = ball;
}

/* Merges the lessons of one cell to a ball: second moment of the values, and their mean position weighted with squares.
 */
static struct kiln_view_source_ball gather(const struct lesson *lessons, size_t count, double *sum)
{
    struct kiln_dvec3 place = {0.0, 0.0, 0.0};
    double moment = 0.0;
    for (size_t i = 0; i < count; i++) {
        const double value = (double)lessons[i].value;
        *sum += value;
        moment += value * value;
        place = dvec3_add(place, dvec3_scale(dvec3_of(lessons[i].found), value * value));
    }
    return (struct kiln_view_source_ball){.middle = vec3_of(dvec3_scale(place, moment > 0.0 ? 1.0 / moment : 0.0)),
                                          .part = (float)moment};
}

/* Builds a region from its lessons, which are sorted by cell. */
static void make_region(struct region *r, uint32_t most, const struct lesson *lessons, size_t count)
{
    double sum = 0.0, moment = 0.0, kept = 0.0;
    for (size_t i = 0, next; i < count; i = next) {
        for (next = i + 1; next < count && lessons[next].cell == lessons[i].cell; next++)
            ;
        const struct kiln_view_source_ball ball = gather(lessons + i, next - i, &sum);
        moment += (double)ball.part;
        if (ball.part > 0.0f)
            keep(r, most, ball);
    }
    for (uint32_t k = 0; k < r->count; k++)
        kept += (double)r->balls[k].part;
    for (uint32_t k = 0; k < r->count; k++)
        r->balls[k].part = (float)((double)r->balls[k].part / kept);
    r->differ = moment > 0.0 ? (float)fmax(0.0, 1.0 - sum * sum / ((double)count * moment)) : 0.0f;
}

static int compare_regions(const void *a, const void *b)
{
    const int by = compare_u32(((const struct lesson *)a)->region, ((const struct lesson *)b)->region);
    return by != 0 ? by : compare_lessons(a, b);
}

/* Adds the sources of the whole picture to a region. */
static void add_all(struct region *r, const struct region *all)
{
    const float left = r->count > 0 ? left_to_all : 1.0f;
    for (uint32_t k = 0; k < r->count; k++)
        r->balls[k].part *= 1.0f - left;
    r->differ = fmaxf(r->differ, all->differ);
    for (uint32_t k = 0; k < all->count; k++) {
        r->balls[r->count] = all->balls[k];
        r->balls[r->count++].part *= left;
    }
}

void kiln_view_guides_finish(struct kiln_view_guides *guides)
{
    const struct lesson *lessons = guides->lessons;
    struct region all = {.count = 0};
    qsort(guides->lessons, guides->count, sizeof *guides->lessons, compare_lessons);
    make_region(&all, ALL_BALLS, lessons, guides->count);
    qsort(guides->lessons, guides->count, sizeof *guides->lessons, compare_regions);
    for (size_t i = 0, next; i < guides->count; i = next) {
        for (next = i + 1; next < guides->count && lessons[next].region == lessons[i].region; next++)
            ;
        make_region(&guides->regions[lessons[i].region], OWN_BALLS, lessons + i, next - i);
    }
    for (uint32_t i = 0; i < REGIONS; i++)
        add_all(&guides->regions[i], &all);
    kiln_free(&guides->lessons);
    guides->count = guides->capacity = 0;
}

/* ---- use ---- */

struct kiln_view_guide kiln_view_guides_at(const struct kiln_view_guides *guides, uint32_t region,
                                           const struct kiln_particle_place *place)
{
    const float alpha = fmaxf(place->lobes.alpha_x, place->lobes.alpha_y);
    if (region == KILN_NONE || guides->regions[region].count == 0)
        return (struct kiln_view_guide){.count = 0};
    const struct region *r = &guides->regions[region];
    return (struct kiln_view_guide){.balls = r->balls,
                                    .count = r->count,
                                    .radius = radius * guides->longest / (float)FOUND_CELLS,
                                    .share = most_guided * r->differ * fminf(alpha / wide, 1.0f)};
}

/* Cosine of half the angle of the cone in which a ball is seen; -1 from within the ball. */
static float cone_of(const struct kiln_view_guide *guide, const struct kiln_view_source_ball *ball,
                     const struct kiln_particle_place *place, struct kiln_vec3 *axis)
{
    const struct kiln_vec3 to = vec3_sub(ball->middle, place->position);
    const float square = vec3_dot(to, to), ratio = guide->radius * guide->radius / square;
    if (!(ratio < 1.0f)) {
        *axis = (struct kiln_vec3){0.0f, 1.0f, 0.0f};
        return -1.0f;
    }
    *axis = vec3_scale(to, 1.0f / sqrtf(square));
    return sqrtf(1.0f - ratio);
}

static float cone_density(float cosine) { return 1.0f / (2.0f * (float)KILN_PI * (1.0f - cosine)); }

float kiln_view_guide_density(const struct kiln_view_guide *guide, const struct kiln_particle_place *place,
                              struct kiln_vec3 direction, float density)
{
    float own = 0.0f;
    if (guide->count == 0)
        return density;
    for (uint32_t k = 0; k < guide->count; k++) {
        struct kiln_vec3 axis;
        const float cosine = cone_of(guide, &guide->balls[k], place, &axis);
        if (vec3_dot(axis, direction) >= cosine)
            own += guide->balls[k].part * cone_density(cosine);
    }
    return (1.0f - guide->share) * density + guide->share * own;
}

/* Draws a ball, and a direction within its cone. */
static struct kiln_vec3 draw(const struct kiln_view_guide *guide, const struct kiln_particle_place *place,
                             const struct kiln_particle_chance *own)
{
    double pick, u, v, rest;
    struct kiln_vec3 axis;
    uint32_t k = 0;
    kiln_particle_draw(own, KILN_PATH_LOBE, &pick, &rest);
    kiln_particle_draw(own, KILN_PATH_BOUNCE, &u, &v);
    for (; k < guide->count - 1 && pick >= (double)guide->balls[k].part; k++)
        pick -= (double)guide->balls[k].part;
    const double cosine = (double)cone_of(guide, &guide->balls[k], place, &axis), up = 1.0 - u * (1.0 - cosine),
                 aside = sqrt(fmax(0.0, 1.0 - up * up)), turn = 2.0 * KILN_PI * v;
    const struct kiln_frame frame = kiln_frame_about(axis);
    return kiln_out_of_frame(&frame, vec3_of(dvec3(aside * cos(turn), aside * sin(turn), up)));
}

struct kiln_particle_turn kiln_view_guide_turn(const struct kiln_view_guide *guide,
                                               const struct kiln_particle_place *place, const float weight[3],
                                               const struct kiln_particle_chance *chance)
{
    const struct kiln_particle_chance own = own_chance(chance);
    double pick = 1.0, rest;
    if (guide->count > 0)
        kiln_particle_draw(&own, KILN_PATH_END, &pick, &rest);
    if (pick < (double)guide->share) {
        const struct kiln_vec3 direction = draw(guide, place, &own);
        const float lobe = kiln_particle_scatter(place, direction).density;
        return kiln_particle_turn_to(place, weight, chance, direction,
                                     kiln_view_guide_density(guide, place, direction, lobe));
    }
    struct kiln_particle_turn turn = kiln_particle_turn(place, weight, chance, KILN_RADIANCE);
    const bool goes_on = turn.goes_on[0] > 0.0f || turn.goes_on[1] > 0.0f || turn.goes_on[2] > 0.0f;
    if (guide->count == 0 || !goes_on || !(turn.mirrored || turn.density > 0.0f))
        return turn;
    const float both = kiln_view_guide_density(guide, place, turn.direction, turn.density),
                factor = turn.mirrored ? 1.0f / (1.0f - guide->share) : turn.density / both;
    for (int c = 0; c < 3; c++)
        turn.goes_on[c] *= factor;
    turn.density = both;
    return turn;
}
