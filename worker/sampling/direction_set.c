#include "worker/sampling/direction_set.h"

#include <math.h>
#include <stdbool.h>
#include <stddef.h>

#include "worker/base/memory.h"
#include "worker/base/vector.h"

#define GOLDEN 0.61803398874989484820 /* of a circle, from one direction to the next */
#define RADIUS_MOST 0.99999           /* so that a ray does not go along the surface */

void kiln_directions_fibonacci(struct kiln_direction *set, uint32_t count)
{
    for (uint32_t k = 0; k < count; k++) {
        const double z = 1.0 - (k + 0.5) / count, turn = k * GOLDEN;
        set[k] = (struct kiln_direction){(float)sqrt(1.0 - z * z), (float)(turn - floor(turn)), (float)(2.0 * z)};
        if (!(set[k].turn < 1.0f))
            set[k].turn = 0.0f;
    }
}

/* ---- largest empty circles ---- */

#define CLOSENESS (1.0 / 64.0) /* allowed distance of a centre from the best one, over the circle's radius */

/* A square of the plane: the disk's point nearest to its centre, and the distance of this point to the nearest place.
 */
struct square {
    double x, y, half, at[2], distance, bound; /* bound: upper bound of the distance in the square */
    uint32_t known;                            /* places that the distance is of */
};

/* Squares that cover the disk, in a heap with the largest bound first. Bounds only decrease, so outdated ones remain
 * upper bounds. */
struct search {
    struct square *squares;
    size_t count, room;
    double (*places)[2];
    uint32_t placed;
};

static bool is_before(const struct square *a, const struct square *b)
{
    if (a->bound != b->bound)
        return a->bound > b->bound;
    return a->y != b->y ? a->y < b->y : a->x < b->x;
}

static int put(struct search *s, const struct square *q, struct kiln_error *error)
{
    const int status = kiln_grow(&s->squares, &s->room, s->count + 1, sizeof *s->squares, "empty circles", error);
    if (status != KILN_OK)
        return status;
    size_t i = s->count++;
    for (; i > 0 && is_before(q, &s->squares[(i - 1) / 2]); i = (i - 1) / 2)
        s->squares[i] = s->squares[(i - 1) / 2];
    s->squares[i] = *q;
    return KILN_OK;
}

static struct square take(struct search *s)
{
    const struct square first = s->squares[0], last = s->squares[--s->count];
    size_t i = 0;
    for (size_t child = 1; child < s->count; child = 2 * i + 1) {
        child += child + 1 < s->count && is_before(&s->squares[child + 1], &s->squares[child]);
        if (!is_before(&s->squares[child], &last))
            break;
        s->squares[i] = s->squares[child];
        i = child;
    }
    s->squares[i] = last;
    return first;
}

/* Updates a square. The disk's point nearest to the centre is at least as close as the centre to all points of the disk
 * in the square, so it may replace the centre. */
static void look(const struct search *s, struct square *q)
{
    for (; q->known < s->placed; q->known++)
        q->distance = fmin(q->distance, hypot(q->at[0] - s->places[q->known][0], q->at[1] - s->places[q->known][1]));
    q->bound = q->distance + q->half * sqrt(2.0);
}

static int put_square(struct search *s, double x, double y, double half, struct kiln_error *error)
{
    const double from = hypot(x, y), scale = from > 1.0 ? 1.0 / from : 1.0;
    struct square q = {.x = x, .y = y, .half = half, .at = {scale * x, scale * y}, .distance = INFINITY};
    if (hypot(fmax(0.0, fabs(x) - half), fmax(0.0, fabs(y) - half)) > 1.0)
        return KILN_OK; /* beside the disk */
    look(s, &q);
    return put(s, &q, error);
}

static int split(struct search *s, const struct square *q, struct kiln_error *error)
{
    const double half = 0.5 * q->half;
    int status = KILN_OK;
    for (int i = 0; i < 4 && status == KILN_OK; i++)
        status = put_square(s, q->x + (i % 2 == 0 ? -half : half), q->y + (i / 2 == 0 ? -half : half), half, error);
    return status;
}

static int place_one(struct search *s, struct kiln_error *error)
{
    int status = KILN_OK;
    for (bool found = false; !found && status == KILN_OK;) {
        struct square q = take(s);
        const bool is_new = q.known == s->placed;
        look(s, &q);
        found = is_new && q.half * sqrt(2.0) <= CLOSENESS * q.distance;
        status = is_new && !found ? split(s, &q, error) : put(s, &q, error);
        if (found) {
            s->places[s->placed][0] = q.at[0];
            s->places[s->placed++][1] = q.at[1];
        }
    }
    return status;
}

/* ---- share of the disk that is nearest to a place ---- */

enum { RIM = 512 }; /* sides of a polygon that approximates the disk */

struct polygon {
    double (*corners)[2], (*spare)[2];
    uint32_t count;
};

/* Clips a convex polygon to (x, y).n <= most. */
static void cut(struct polygon *p, double nx, double ny, double most)
{
    uint32_t count = 0;
    for (uint32_t i = 0; i < p->count; i++) {
        const double *a = p->corners[i], *b = p->corners[(i + 1) % p->count];
        const double out_a = nx * a[0] + ny * a[1] - most, out_b = nx * b[0] + ny * b[1] - most;
        if (out_a <= 0.0) {
            p->spare[count][0] = a[0];
            p->spare[count++][1] = a[1];
        }
        if ((out_a <= 0.0) != (out_b <= 0.0)) {
            const double t = out_a / (out_a - out_b);
            p->spare[count][0] = a[0] + t * (b[0] - a[0]);
            p->spare[count++][1] = a[1] + t * (b[1] - a[1]);
        }
    }
    double(*swap)[2] = p->corners;
    p->corners = p->spare;
    p->spare = swap;
    p->count = count;
}

static double area_of(const struct polygon *p, double middle[2])
{
    double twice = 0.0;
    middle[0] = middle[1] = 0.0;
    for (uint32_t i = 0; i < p->count; i++) {
        const double *a = p->corners[i], *b = p->corners[(i + 1) % p->count], part = a[0] * b[1] - a[1] * b[0];
        twice += part;
        for (int c = 0; c < 2; c++)
            middle[c] += part * (a[c] + b[c]);
    }
    for (int c = 0; c < 2; c++)
        middle[c] /= 3.0 * twice;
    return 0.5 * twice;
}

/* Share of the disk that is nearer to place k than to any other place, and the centroid of this part. */
static double share_of(const struct search *s, struct polygon *p, uint32_t k, double middle[2])
{
    static const double around[4][2] = {{-2.0, -2.0}, {2.0, -2.0}, {2.0, 2.0}, {-2.0, 2.0}};
    const double *at = s->places[k], inner = sqrt(KILN_PI / (RIM * tan(KILN_PI / RIM))); /* of the area of the disk */
    p->count = 4;
    for (int i = 0; i < 4; i++) {
        p->corners[i][0] = around[i][0];
        p->corners[i][1] = around[i][1];
    }
    for (uint32_t i = 0; i < s->placed; i++) {
        const double *other = s->places[i];
        if (i != k)
            cut(p, other[0] - at[0], other[1] - at[1],
                0.5 * (other[0] * other[0] + other[1] * other[1] - at[0] * at[0] - at[1] * at[1]));
    }
    for (int i = 0; i < RIM; i++)
        cut(p, cos(2.0 * KILN_PI * i / RIM), sin(2.0 * KILN_PI * i / RIM), inner);
    return area_of(p, middle) / KILN_PI;
}

static int fill_set(const struct search *s, struct kiln_direction *set, struct kiln_error *error)
{
    struct polygon p = {NULL, NULL, 0};
    const size_t corners = 4 + (size_t)RIM + s->placed;
    int status;
    KILN_TRY(kiln_allocate(&p.corners, corners, sizeof *p.corners, "a part of the disk", error));
    KILN_TRY(kiln_allocate(&p.spare, corners, sizeof *p.spare, "a part of the disk", error));
    for (uint32_t k = 0; k < s->placed; k++) {
        double at[2];
        const double weight = share_of(s, &p, k, at) * s->placed, turn = atan2(at[1], at[0]) / (2.0 * KILN_PI);
        set[k] = (struct kiln_direction){.radius = (float)fmin(hypot(at[0], at[1]), RADIUS_MOST),
                                         .turn = (float)(turn < 0.0 ? turn + 1.0 : turn),
                                         .weight = (float)weight};
        if (!(set[k].turn < 1.0f))
            set[k].turn = 0.0f;
    }
end:
    kiln_free(&p.corners);
    kiln_free(&p.spare);
    return status;
}

int kiln_directions_circles(struct kiln_direction *set, uint32_t count, struct kiln_error *error)
{
    struct search s = {.count = 0};
    int status;
    KILN_TRY(kiln_allocate(&s.places, count, sizeof *s.places, "directions", error));
    /* (0, 0) is the centre of the largest empty circle in the empty disk */
    s.placed = 1;
    KILN_TRY(put_square(&s, 0.0, 0.0, 1.0, error));
    while (s.placed < count)
        KILN_TRY(place_one(&s, error));
    KILN_TRY(fill_set(&s, set, error));
end:
    kiln_free(&s.squares);
    kiln_free(&s.places);
    return status;
}
