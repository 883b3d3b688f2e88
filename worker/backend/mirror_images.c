#include "worker/backend/mirror_images.h"

#include <math.h>
#include <stdlib.h>

#include "worker/base/arena.h"
#include "worker/base/memory.h"
#include "worker/material/surface_bsdf.h"
#include "worker/scene/footprint.h"
#include "worker/scene/gloss.h"

#define STRAIGHT 1e-4         /* largest difference between shading normals and the plane's normal */
#define NORMAL_STEP 0x1p-14   /* grid step of the key: normals and distances of a plane round to equal values */
#define DISTANCE_STEP 0x1p-17 /* of the world's extent */
#define SLACK 1e-5            /* enlargement of boxes, over the world's extent */
/* Margins far above rounding errors. LEAST_HEIGHT: least height over a plane of boxes of positions, and enlargement of
 * boxes within the plane, over the world's extent. Then the least slope of light from outside. */
#define LEAST_HEIGHT 1e-6
#define ROUNDING 1e-8
#define LEAST_FALL 1e-3

/* A triangle that reflects. Faces in one plane have the same key. */
struct face {
    int64_t key[4];
    uint32_t triangle;
};

/* ---- which triangles reflect ---- */

/* Finds which materials are flat mirrors. The caller frees the array. */
static int find_mirrors(bool **mirrors, const struct kiln_scene *scene, struct kiln_error *error)
{
    const int status = kiln_allocate(mirrors, scene->material_count, sizeof **mirrors, "the mirrors", error);
    for (uint32_t m = 0; status == KILN_OK && m < scene->material_count; m++) {
        const struct kiln_gloss_lobes of = kiln_gloss_lobes(scene, m);
        (*mirrors)[m] = of.ready && of.lobes.base_is_mirror && of.lobes.p.model == KILN_BSDF_LAYERS &&
                        !(of.lobes.coat.strength > 0.0f);
    }
    return status;
}

static bool is_flat(const struct kiln_lights *l, uint32_t triangle, struct kiln_vec3 normal)
{
    const struct kiln_object *object = &l->scene->objects[l->geometry->records[triangle].object];
    if ((l->scene->meshes[object->mesh].flags & KILN_MESH_SMOOTH) == 0)
        return true;
    for (int c = 0; c < 3; c++) {
        const struct kiln_vec3 s =
            kiln_triangle_shading_normal(l->scene, l->geometry, triangle, c == 1 ? 1.0f : 0.0f, c == 2 ? 1.0f : 0.0f);
        if (!((double)vec3_length(vec3_sub(s, normal)) < STRAIGHT))
            return false;
    }
    return true;
}

static bool reflects(const struct kiln_lights *l, const bool *mirrors, uint32_t triangle)
{
    const struct kiln_hit_record *record = &l->geometry->records[triangle];
    return mirrors[record->material & KILN_RECORD_MATERIAL] &&
           (l->scene->objects[record->object].flags & KILN_OBJECT_RECEIVER_ONLY) == 0;
}

static size_t find_faces(const struct kiln_lights *l, const bool *mirrors, struct face *faces)
{
    const struct kiln_geometry *g = l->geometry;
    size_t count = 0;
    for (uint32_t t = 0; t < g->triangle_count; t++) {
        struct kiln_vec3 corner[3];
        if (!reflects(l, mirrors, t) || !(kiln_geometry_triangle_area(g, t) > 0.0))
            continue;
        const struct kiln_vec3 n = kiln_triangle_exact_normal(l->scene, g, t);
        if (!is_flat(l, t, n))
            continue;
        kiln_geometry_corners(g, t, corner);
        const double distance = dvec3_dot(dvec3_of(n), dvec3_of(corner[0]));
        faces[count++] =
            (struct face){{llrint((double)n.x / NORMAL_STEP), llrint((double)n.y / NORMAL_STEP),
                           llrint((double)n.z / NORMAL_STEP), llrint(distance / ((double)g->extent * DISTANCE_STEP))},
                          t};
    }
    return count;
}

/* ---- planes ---- */

static int by_key(const void *a, const void *b)
{
    const struct face *x = a, *y = b;
    for (int i = 0; i < 4; i++)
        if (x->key[i] != y->key[i])
            return x->key[i] < y->key[i] ? -1 : 1;
    return x->triangle < y->triangle ? -1 : x->triangle > y->triangle;
}

static bool same_plane(const struct face *a, const struct face *b)
{
    return a->key[0] == b->key[0] && a->key[1] == b->key[1] && a->key[2] == b->key[2] && a->key[3] == b->key[3];
}

/* Faces of one plane, from `first` on. */
struct group {
    size_t first, count;
    double area;
};

static int by_area(const void *a, const void *b)
{
    const struct group *x = a, *y = b;
    if (x->area != y->area)
        return x->area > y->area ? -1 : 1;
    return x->first < y->first ? -1 : 1;
}

static size_t find_groups(const struct kiln_geometry *g, const struct face *faces, size_t count, struct group *groups)
{
    size_t n = 0;
    for (size_t i = 0; i < count; i++) {
        if (i == 0 || !same_plane(&faces[i - 1], &faces[i]))
            groups[n++] = (struct group){.first = i};
        groups[n - 1].count++;
        groups[n - 1].area += kiln_geometry_triangle_area(g, faces[i].triangle);
    }
    qsort(groups, n, sizeof *groups, by_area);
    return n;
}

/* Means of normals and distances, weighted by area, since they differ by rounding; and the bounding box. */
static struct kiln_mirror_plane make_plane(const struct kiln_lights *l, const struct face *faces, size_t count)
{
    const struct kiln_geometry *g = l->geometry;
    const double slack = SLACK * (double)g->extent;
    struct kiln_mirror_plane p = {.minimum = dvec3(INFINITY, INFINITY, INFINITY),
                                  .maximum = dvec3(-INFINITY, -INFINITY, -INFINITY)};
    for (size_t i = 0; i < count; i++) {
        struct kiln_vec3 corner[3];
        const double area = kiln_geometry_triangle_area(g, faces[i].triangle);
        const struct kiln_dvec3 n = dvec3_of(kiln_triangle_exact_normal(l->scene, g, faces[i].triangle));
        kiln_geometry_corners(g, faces[i].triangle, corner);
        p.area += area;
        p.normal = dvec3_add(p.normal, dvec3_scale(n, area));
        p.distance += area * dvec3_dot(n, dvec3_of(corner[0]));
        for (int c = 0; c < 3; c++) {
            const struct kiln_dvec3 at = dvec3_of(corner[c]);
            p.minimum = dvec3(fmin(p.minimum.x, at.x - slack), fmin(p.minimum.y, at.y - slack),
                              fmin(p.minimum.z, at.z - slack));
            p.maximum = dvec3(fmax(p.maximum.x, at.x + slack), fmax(p.maximum.y, at.y + slack),
                              fmax(p.maximum.z, at.z + slack));
        }
    }
    p.normal = dvec3_scale(p.normal, 1.0 / dvec3_length(p.normal));
    p.distance /= p.area;
    return p;
}

static int take_planes(struct kiln_mirror_images *m, const struct face *faces, const struct group *groups, size_t count,
                       struct kiln_error *error)
{
    const size_t triangles = m->lights->geometry->triangle_count, most = KILN_IMAGES_MOST / m->lamp_count;
    m->plane_count = count < most ? count : most;
    int status;
    KILN_TRY(
        kiln_arena_allocate(&m->arena, &m->planes, m->plane_count, sizeof *m->planes, "the planes of mirrors", error));
    KILN_TRY(
        kiln_arena_allocate(&m->arena, &m->plane_of, triangles, sizeof *m->plane_of, "the planes of triangles", error));
    for (size_t t = 0; t < triangles; t++)
        m->plane_of[t] = KILN_NONE;
    for (size_t i = 0; i < m->plane_count; i++) {
        m->planes[i] = make_plane(m->lights, faces + groups[i].first, groups[i].count);
        for (size_t k = 0; k < groups[i].count; k++)
            m->plane_of[faces[groups[i].first + k].triangle] = (uint32_t)i;
    }
end:
    return status;
}

static int find_planes(struct kiln_mirror_images *m, struct kiln_error *error)
{
    const struct kiln_lights *l = m->lights;
    struct face *faces = NULL;
    struct group *groups = NULL;
    bool *mirrors = NULL;
    size_t room = 0;
    int status;
    KILN_TRY(find_mirrors(&mirrors, l->scene, error));
    for (uint32_t t = 0; t < l->geometry->triangle_count; t++)
        room += reflects(l, mirrors, t);
    KILN_TRY(kiln_allocate(&faces, room, sizeof *faces, "the faces of mirrors", error));
    KILN_TRY(kiln_allocate(&groups, room, sizeof *groups, "the planes of mirrors", error));
    const size_t count = find_faces(l, mirrors, faces);
    qsort(faces, count, sizeof *faces, by_key);
    KILN_TRY(take_planes(m, faces, groups, find_groups(l->geometry, faces, count, groups), error));
end:
    kiln_free(&faces);
    kiln_free(&groups);
    kiln_free(&mirrors);
    return status;
}

/* ---- lamps ---- */

static int find_lamps(struct kiln_mirror_images *m, struct kiln_error *error)
{
    const struct kiln_lights *l = m->lights;
    const size_t count = l->point_count + l->directional_count;
    const int status =
        kiln_arena_allocate(&m->arena, &m->lamps, count, sizeof *m->lamps, "the lamps that mirrors show", error);
    for (size_t i = 0; status == KILN_OK && i < l->point_count; i++)
        m->lamps[m->lamp_count++] = (struct kiln_mirror_lamp){.index = (uint32_t)i, .place = l->points[i].position};
    for (size_t i = 0; status == KILN_OK && i < l->directional_count; i++)
        m->lamps[m->lamp_count++] =
            (struct kiln_mirror_lamp){.outside = true, .index = (uint32_t)i, .place = l->directionals[i].towards};
    return status;
}

/* In the box. */
static bool is_within(const struct kiln_mirror_plane *plane, struct kiln_dvec3 p)
{
    return p.x >= plane->minimum.x && p.x <= plane->maximum.x && p.y >= plane->minimum.y && p.y <= plane->maximum.y &&
           p.z >= plane->minimum.z && p.z <= plane->maximum.z;
}

/* m2: area of a spot's beam, perpendicular to its axis, where the axis crosses the plane; INFINITY: it does not hit the
 * front. */
static double beam_area(const struct kiln_point_light *spot, const struct kiln_mirror_plane *plane)
{
    const double height = dvec3_dot(plane->normal, spot->position) - plane->distance,
                 falls = -dvec3_dot(plane->normal, spot->direction), cosine = spot->cos_outer;
    if (!(height > 0.0) || !(falls > 0.0))
        return INFINITY;
    const double along = height / falls;
    const struct kiln_dvec3 p = dvec3_add(spot->position, dvec3_scale(spot->direction, along));
    return is_within(plane, p) ? KILN_PI * along * along * (1.0 - cosine * cosine) / (cosine * cosine) : INFINITY;
}

static bool has_narrow_beam(const struct kiln_mirror_images *m, double least)
{
    for (size_t i = 0; i < m->lights->point_count; i++)
        for (size_t k = 0; k < m->plane_count && m->lights->points[i].spot; k++)
            if (beam_area(&m->lights->points[i], &m->planes[k]) < least)
                return true;
    return false;
}

int kiln_mirror_images_create(struct kiln_mirror_images **images, const struct kiln_lights *lights, double least,
                              struct kiln_error *error)
{
    const size_t lamps = lights->point_count + lights->directional_count;
    struct kiln_mirror_images *m = NULL;
    *images = NULL;
    if (lamps == 0 || lamps > KILN_IMAGES_MOST || lights->scene->taken == NULL)
        return KILN_OK;
    int status = kiln_allocate(&m, 1, sizeof *m, "the images in mirrors", error);
    if (status != KILN_OK)
        return status;
    m->lights = lights;
    status = find_lamps(m, error);
    if (status == KILN_OK)
        status = find_planes(m, error);
    if (status != KILN_OK || m->plane_count == 0 || has_narrow_beam(m, least))
        kiln_mirror_images_destroy(&m);
    *images = m;
    return status;
}

void kiln_mirror_images_destroy(struct kiln_mirror_images **images)
{
    if (*images == NULL)
        return;
    kiln_arena_release(&(*images)->arena);
    kiln_free(images);
}

/* ---- images ---- */

/* From the plane up to the lamp. */
static double height_of(const struct kiln_mirror_plane *plane, const struct kiln_mirror_lamp *lamp)
{
    return dvec3_dot(plane->normal, lamp->place) - (lamp->outside ? 0.0 : plane->distance);
}

bool kiln_mirror_image(const struct kiln_mirror_plane *plane, const struct kiln_mirror_lamp *lamp, struct kiln_dvec3 p,
                       struct kiln_dvec3 *direction)
{
    const struct kiln_dvec3 n = plane->normal;
    const double above = dvec3_dot(n, p) - plane->distance, height = height_of(plane, lamp);
    if (!(above > 0.0) || !(height > 0.0))
        return false;
    const struct kiln_dvec3 image = dvec3_sub(lamp->place, dvec3_scale(n, 2.0 * height)),
                            way = lamp->outside ? image : dvec3_sub(image, p);
    /* the plane's share of the distance; for light from outside the distance itself */
    const double until = above / (lamp->outside ? height : above + height);
    *direction = dvec3_scale(way, 1.0 / dvec3_length(way));
    return is_within(plane, dvec3_add(p, dvec3_scale(way, until)));
}

/* The point of the plane where p, above it, sees the lamp mirrored. */
static struct kiln_dvec3 place_in_plane(const struct kiln_mirror_plane *plane, const struct kiln_mirror_lamp *lamp,
                                        double height, double above, struct kiln_dvec3 p)
{
    const struct kiln_dvec3 image = dvec3_sub(lamp->place, dvec3_scale(plane->normal, 2.0 * height));
    return lamp->outside ? dvec3_add(p, dvec3_scale(image, above / height))
                         : dvec3_add(p, dvec3_scale(dvec3_sub(image, p), above / (above + height)));
}

/* Returns whether any position in the box may see the lamp mirrored. A position between others sees it at a point of
 * the plane between theirs, so testing the box's corners suffices. */
bool kiln_mirror_may_show(const struct kiln_mirror_plane *plane, const struct kiln_mirror_lamp *lamp,
                          struct kiln_dvec3 minimum, struct kiln_dvec3 maximum, double extent)
{
    const double height = height_of(plane, lamp), least = LEAST_HEIGHT * extent, slack = ROUNDING * extent;
    struct kiln_dvec3 low = dvec3(INFINITY, INFINITY, INFINITY), high = dvec3(-INFINITY, -INFINITY, -INFINITY);
    int above_it = 0, below_it = 0;
    if (!(height > 0.0))
        return false;
    for (int i = 0; i < 8; i++) {
        const struct kiln_dvec3 p = dvec3((i & 1) != 0 ? maximum.x : minimum.x, (i & 2) != 0 ? maximum.y : minimum.y,
                                          (i & 4) != 0 ? maximum.z : minimum.z);
        const double above = dvec3_dot(plane->normal, p) - plane->distance;
        above_it += above > least;
        below_it += above < -least;
        if (above > least) {
            const struct kiln_dvec3 q = place_in_plane(plane, lamp, height, above, p);
            low = dvec3(fmin(low.x, q.x), fmin(low.y, q.y), fmin(low.z, q.z));
            high = dvec3(fmax(high.x, q.x), fmax(high.y, q.y), fmax(high.z, q.z));
        }
    }
    if (above_it < 8 || (lamp->outside && height < LEAST_FALL))
        return below_it < 8;
    return low.x <= plane->maximum.x + slack && high.x >= plane->minimum.x - slack &&
           low.y <= plane->maximum.y + slack && high.y >= plane->minimum.y - slack &&
           low.z <= plane->maximum.z + slack && high.z >= plane->minimum.z - slack;
}
