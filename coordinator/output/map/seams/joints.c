#include "coordinator/output/map/seams/joints.h"

#include <math.h>
#include <stdlib.h>

#include "coordinator/output/map/seams/edge_tree.h"
#include "coordinator/output/points.h"
#include "worker/base/arena.h"
#include "worker/base/disjoint_sets.h"
#include "worker/base/memory.h"

/* Smallest tolerance for a gap, relative to the scene's extent: positions are rounded to float. */
static const double least_gap = 0x1p-21;
/* Largest tolerance for a gap, in texels. */
static const double texel_gap = 1.0 / 16.0;
/* Shorter edges and joints are left out; length on the layout, in texels. */
static const double least_texels = 1.0 / 64.0;
/* Largest cosine between the directions from the edge into both triangles: that of a fold of 37 degrees. */
static const double opposite = -0.8;

/* Where an edge comes from. */
struct origin {
    uint32_t map, triangle, corner; /* triangle: of the mesh; the edge leads from the corner to the next */
};

struct search {
    const struct kiln_scene *scene;
    const struct kiln_surface *surface;
    double extent;
    struct kiln_box *boxes, *clips; /* per object: its bounding box; the part of it where other objects are */
    uint8_t **ends;                 /* of each mesh that is needed: kiln_mesh_ends */
    struct origin *origins;         /* of each edge, */
    struct kiln_edge *edges;        /* for each side, its edge in m from the scene's centre */
    size_t edge_count, origin_capacity, edge_capacity;
    struct kiln_edge_tree *tree;
    struct found *found;
    size_t found_count, found_capacity;
    struct kiln_arena arena;
};

/* A joint of the edges a and b. */
struct found {
    uint32_t a, b;
    struct kiln_joint joint;
};

static struct kiln_dvec3 place(const struct kiln_scene *scene, const double m[12], uint64_t vertex)
{
    const struct kiln_dvec3 p = dvec3_of(scene->positions[vertex]);
    const double *centre = scene->header->centre;
    return dvec3(m[0] * p.x + m[1] * p.y + m[2] * p.z + (m[3] - centre[0]),
                 m[4] * p.x + m[5] * p.y + m[6] * p.z + (m[7] - centre[1]),
                 m[8] * p.x + m[9] * p.y + m[10] * p.z + (m[11] - centre[2]));
}

/* ---- boxes of objects ---- */

static bool is_published(const struct kiln_surface *surface, uint32_t object)
{
    return surface->lightmaps[object].published != 0 ||
           (surface->whole_maps > surface->object_count &&
            surface->lightmaps[surface->object_count + object].published != 0);
}

/* Finds the box of each object with a published lightmap, enlarged by the gap. */
static void find_boxes(const struct search *s)
{
    const float gap = (float)(KILN_JOINT_GAP * s->extent);
#pragma omp parallel for schedule(dynamic, 16)
    for (uint32_t i = 0; i < s->surface->object_count; i++) {
        const struct kiln_mesh *mesh = &s->scene->meshes[s->scene->objects[i].mesh];
        s->boxes[i] = s->clips[i] = kiln_box_empty();
        for (uint64_t v = 0; is_published(s->surface, i) && v < mesh->vertex_count; v++) {
            const struct kiln_vec3 p = vec3_of(place(s->scene, s->scene->objects[i].transform, mesh->vertex_first + v));
            kiln_box_add(&s->boxes[i], (const float[3]){p.x, p.y, p.z});
        }
        kiln_box_widen(&s->boxes[i], gap);
    }
}

static int compare_lows(const void *a, const void *b, void *context)
{
    const struct kiln_box *boxes = context;
    const uint32_t i = *(const uint32_t *)a, j = *(const uint32_t *)b;
    if (boxes[i].low[0] != boxes[j].low[0])
        return boxes[i].low[0] < boxes[j].low[0] ? -1 : 1;
    return (i > j) - (i < j);
}

/* Finds for each object the part of its box that boxes of other objects overlap. */
static int find_clips(const struct search *s, struct kiln_error *error)
{
    uint32_t *order = NULL;
    const uint32_t count = s->surface->object_count;
    const int status = kiln_allocate(&order, count, sizeof *order, "the order of objects", error);
    if (status != KILN_OK)
        return status;
    for (uint32_t i = 0; i < count; i++)
        order[i] = i;
    qsort_r(order, count, sizeof *order, compare_lows, s->boxes);
    for (uint32_t i = 0; i < count; i++) {
        const struct kiln_box *own = &s->boxes[order[i]];
        for (uint32_t j = i + 1; j < count && s->boxes[order[j]].low[0] <= own->high[0]; j++) {
            const struct kiln_box common = kiln_box_common(own, &s->boxes[order[j]]);
            kiln_box_join(&s->clips[order[i]], &common);
            kiln_box_join(&s->clips[order[j]], &common);
        }
    }
    kiln_free(&order);
    return KILN_OK;
}

/* ---- edges ---- */

static uint64_t vertex_of(const struct search *s, const struct origin *at, uint32_t corner)
{
    const struct kiln_mesh *mesh = &s->scene->meshes[s->scene->objects[kiln_map_object(s->surface, at->map)].mesh];
    return mesh->vertex_first + s->scene->triangles[3 * (mesh->triangle_first + at->triangle) + corner % 3];
}

static int add_edge(struct search *s, const struct origin *at, struct kiln_error *error)
{
    const uint32_t object = kiln_map_object(s->surface, at->map);
    struct kiln_edge edge;
    struct kiln_box box = kiln_box_empty();
    for (uint32_t e = 0; e < 2; e++) {
        const struct kiln_vec3 p =
            vec3_of(place(s->scene, s->scene->objects[object].transform, vertex_of(s, at, at->corner + e)));
        edge.end[e][0] = p.x;
        edge.end[e][1] = p.y;
        edge.end[e][2] = p.z;
        kiln_box_add(&box, edge.end[e]);
    }
    box = kiln_box_common(&box, &s->clips[object]);
    if (kiln_box_is_empty(&box))
        return KILN_OK;
    if (s->edge_count >= UINT32_MAX - 1)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "more than 2^32 - 2 edges of objects may touch others; bake with --no-stitch");
    int status = kiln_arena_grow(&s->arena, &s->edges, &s->edge_capacity, s->edge_count + 1, sizeof *s->edges,
                                 "edges of objects", error);
    if (status == KILN_OK)
        status = kiln_arena_grow(&s->arena, &s->origins, &s->origin_capacity, s->edge_count + 1, sizeof *s->origins,
                                 "edges of objects", error);
    if (status == KILN_OK) {
        s->edges[s->edge_count] = edge;
        s->origins[s->edge_count++] = *at;
    }
    return status;
}

static int add_map(struct search *s, uint32_t map, struct kiln_error *error)
{
    const uint32_t number = s->scene->objects[kiln_map_object(s->surface, map)].mesh;
    const struct kiln_mesh *mesh = &s->scene->meshes[number];
    int status = KILN_OK;
    for (uint32_t t = 0; status == KILN_OK && t < mesh->triangle_count; t++) {
        const uint32_t material = s->scene->triangle_materials[mesh->triangle_first + t];
        if (kiln_map_back(s->surface, map) && s->scene->materials[material].double_sided == 0)
            continue;
        for (uint32_t c = 0; status == KILN_OK && c < 3; c++)
            if ((s->ends[number][t] >> c & 1u) != 0)
                status = add_edge(s, &(struct origin){map, t, c}, error);
    }
    return status;
}

/* Whether a lightmap may touch others. */
static bool may_touch(const struct search *s, uint32_t map)
{
    return s->surface->lightmaps[map].published != 0 && !kiln_box_is_empty(&s->clips[kiln_map_object(s->surface, map)]);
}

/* Finds the ends of the meshes of lightmaps that may touch others. */
static int find_ends(const struct search *s, struct kiln_error *error)
{
    uint8_t *wanted = NULL;
    int status = kiln_allocate(&wanted, s->scene->mesh_count, 1, "where meshes end", error);
    const uint32_t count = status == KILN_OK ? (uint32_t)s->scene->mesh_count : 0;
    for (uint32_t map = 0; status == KILN_OK && map < s->surface->map_count; map++)
        if (may_touch(s, map))
            wanted[s->scene->objects[kiln_map_object(s->surface, map)].mesh] = 1;
#pragma omp parallel for schedule(dynamic, 1)
    for (uint32_t mesh = 0; mesh < count; mesh++) {
        struct kiln_error mine = {{0}};
        const int result = wanted[mesh] != 0 ? kiln_mesh_ends(&s->ends[mesh], s->scene, mesh, &mine) : KILN_OK;
        if (result == KILN_OK)
            continue;
#pragma omp critical(kiln_find_ends)
        status = kiln_fail(error, result, "%s", mine.message);
    }
    kiln_free(&wanted);
    return status;
}

static int collect_edges(struct search *s, struct kiln_error *error)
{
    int status = find_ends(s, error);
    for (uint32_t map = 0; status == KILN_OK && map < s->surface->map_count; map++)
        if (may_touch(s, map))
            status = add_map(s, map, error);
    return status;
}

/* ---- pairs of edges ---- */

/* An edge with what joining needs. */
struct side {
    struct kiln_dvec3 end[2], normal[2];
    struct kiln_dvec3 into; /* unit: from the edge into its triangle */
    double texel[2][2], length, texels;
    double part[2]; /* where the joint begins and ends on the edge, 0 to 1 */
};

static struct kiln_dvec3 unit(struct kiln_dvec3 v)
{
    const double length = dvec3_length(v);
    return length > 0.0 ? dvec3_scale(v, 1.0 / length) : v;
}

/* False if the edge has no length, or its triangle no area. */
static bool make_side(const struct search *s, size_t edge, struct side *side)
{
    const struct origin *at = &s->origins[edge];
    const struct kiln_object *object = &s->scene->objects[kiln_map_object(s->surface, at->map)];
    const double scale = 1.0 / (double)(1u << s->surface->lightmaps[at->map].shift);
    for (uint32_t e = 0; e < 2; e++) {
        const uint64_t vertex = vertex_of(s, at, at->corner + e);
        const struct kiln_dvec3 normal = kiln_world_normal(object->transform, dvec3_of(s->scene->normals[vertex]));
        side->end[e] = place(s->scene, object->transform, vertex);
        side->normal[e] = kiln_map_back(s->surface, at->map) ? dvec3_scale(normal, -1.0) : normal;
        side->texel[e][0] = (double)s->scene->texcoord_lightmap[vertex].x * object->lightmap_width * scale;
        side->texel[e][1] = (double)s->scene->texcoord_lightmap[vertex].y * object->lightmap_height * scale;
    }
    const struct kiln_dvec3 third = place(s->scene, object->transform, vertex_of(s, at, at->corner + 2)),
                            along = dvec3_sub(side->end[1], side->end[0]), direction = unit(along),
                            away = dvec3_sub(third, side->end[0]);
    side->into = unit(dvec3_sub(away, dvec3_scale(direction, dvec3_dot(away, direction))));
    side->length = dvec3_length(along);
    side->texels = hypot(side->texel[1][0] - side->texel[0][0], side->texel[1][1] - side->texel[0][1]);
    return side->length > 0.0 && side->texels >= least_texels && dvec3_length(side->into) > 0.5;
}

static double gap_of(const struct search *s, const struct side *a, const struct side *b)
{
    const double texel = fmin(a->length / a->texels, b->length / b->texels);
    return fmax(least_gap * s->extent, fmin(KILN_JOINT_GAP * s->extent, texel_gap * texel));
}

/* Finds the common part of two edges, as a range on each. False if they do not lie on one line, or if it is only a few
 * gaps long. */
static bool overlap(struct side *line, struct side *other, double gap)
{
    const struct kiln_dvec3 direction = unit(dvec3_sub(line->end[1], line->end[0]));
    double t[2];
    for (int e = 0; e < 2; e++) {
        const struct kiln_dvec3 away = dvec3_sub(other->end[e], line->end[0]);
        t[e] = dvec3_dot(away, direction);
        if (dvec3_length(dvec3_sub(away, dvec3_scale(direction, t[e]))) > gap)
            return false;
    }
    const double begin = fmax(0.0, fmin(t[0], t[1])), end = fmin(line->length, fmax(t[0], t[1])), run = t[1] - t[0];
    if (!(end - begin > 4.0 * gap) || !(fabs(run) > 0.0))
        return false;
    const double at[2] = {begin, end};
    for (int e = 0; e < 2; e++) {
        line->part[e] = at[e] / line->length;
        other->part[e] = fmin(fmax((at[e] - t[0]) / run, 0.0), 1.0);
    }
    return true;
}

static struct kiln_dvec3 normal_at(const struct side *side, double part)
{
    return unit(dvec3_add(dvec3_scale(side->normal[0], 1.0 - part), dvec3_scale(side->normal[1], part)));
}

static void set_texels(const struct side *side, float texel[2][2])
{
    for (int e = 0; e < 2; e++)
        for (int c = 0; c < 2; c++)
            texel[e][c] = (float)(side->texel[0][c] + side->part[e] * (side->texel[1][c] - side->texel[0][c]));
}

static bool join(const struct search *s, size_t first, size_t second, struct kiln_joint *joint)
{
    struct side a, b;
    if (kiln_map_object(s->surface, s->origins[first].map) == kiln_map_object(s->surface, s->origins[second].map) ||
        !make_side(s, first, &a) || !make_side(s, second, &b) || dvec3_dot(a.into, b.into) > opposite)
        return false;
    const double gap = gap_of(s, &a, &b);
    if (!(a.length >= b.length ? overlap(&a, &b, gap) : overlap(&b, &a, gap)))
        return false;
    for (int e = 0; e < 2; e++)
        if (dvec3_dot(normal_at(&a, a.part[e]), normal_at(&b, b.part[e])) < (double)KILN_SEAM_COSINE)
            return false;
    joint->map[0] = s->origins[first].map;
    joint->map[1] = s->origins[second].map;
    set_texels(&a, joint->edge.texel[0]);
    set_texels(&b, joint->edge.texel[1]);
    return fmax(a.texels * fabs(a.part[1] - a.part[0]), b.texels * fabs(b.part[1] - b.part[0])) >= least_texels;
}

/* ---- all pairs ---- */

/* Joints that one thread finds. */
struct finder {
    const struct search *search;
    size_t edge;
    struct found *found;
    size_t count, capacity;
    int status;
    struct kiln_error error;
};

/* Tries an edge whose box is near the box of the finder's edge. */
static void try_edge(void *context, size_t other)
{
    struct finder *f = context;
    struct found found = {.a = (uint32_t)f->edge, .b = (uint32_t)other};
    if (other <= f->edge || f->status != KILN_OK || !join(f->search, f->edge, other, &found.joint))
        return;
    f->status = kiln_grow(&f->found, &f->capacity, f->count + 1, sizeof *f->found, "joints of objects", &f->error);
    if (f->status == KILN_OK)
        f->found[f->count++] = found;
}

static int hand_over(struct search *s, const struct finder *f, struct kiln_error *error)
{
    int status = f->status;
    if (status == KILN_OK)
        status = kiln_arena_grow(&s->arena, &s->found, &s->found_capacity, s->found_count + f->count, sizeof *s->found,
                                 "joints of objects", error);
    else
        *error = f->error;
    for (size_t i = 0; status == KILN_OK && i < f->count; i++)
        s->found[s->found_count++] = f->found[i];
    return status;
}

static int compare_found(const void *a, const void *b)
{
    const struct found *p = a, *q = b;
    if (p->a != q->a)
        return p->a < q->a ? -1 : 1;
    return (p->b > q->b) - (p->b < q->b);
}

static int find_pairs(struct search *s, struct kiln_error *error)
{
    int status = kiln_edge_tree_create(&s->tree, s->edges, s->edge_count, error);
    if (status != KILN_OK)
        return status;
    const float gap = (float)(KILN_JOINT_GAP * s->extent);
#pragma omp parallel
    {
        struct finder finder = {.search = s};
#pragma omp for schedule(dynamic, 256)
        for (size_t i = 0; i < s->edge_count; i++) {
            finder.edge = i;
            kiln_edge_tree_visit(s->tree, &s->edges[i], gap, try_edge, &finder);
        }
#pragma omp critical(kiln_find_pairs)
        {
            struct kiln_error mine = {{0}};
            const int result = hand_over(s, &finder, &mine);
            if (result != KILN_OK)
                status = kiln_fail(error, result, "%s", mine.message);
        }
        kiln_free(&finder.found);
    }
    if (s->found_count > 1)
        qsort(s->found, s->found_count, sizeof *s->found, compare_found);
    return status;
}

/* ---- result ---- */

static int make_joints(const struct search *s, struct kiln_joints *joints, struct kiln_error *error)
{
    uint32_t *sets = NULL;
    joints->map_count = s->surface->map_count;
    joints->count = s->found_count;
    int status;
    KILN_TRY(kiln_allocate(&joints->joints, s->found_count, sizeof *joints->joints, "joints of objects", error));
    KILN_TRY(kiln_allocate(&joints->group, joints->map_count, sizeof *joints->group, "joints of objects", error));
    KILN_TRY(kiln_allocate(&sets, joints->map_count, sizeof *sets, "joints of objects", error));
end:
    if (status != KILN_OK)
        return status;
    kiln_sets_begin(sets, joints->map_count);
    for (size_t i = 0; i < joints->map_count; i++)
        joints->group[i] = KILN_NONE;
    for (size_t i = 0; i < s->found_count; i++) {
        joints->joints[i] = s->found[i].joint;
        kiln_sets_join(sets, s->found[i].joint.map[0], s->found[i].joint.map[1]);
    }
    for (size_t i = 0; i < s->found_count; i++)
        for (int side = 0; side < 2; side++) {
            const uint32_t map = s->found[i].joint.map[side];
            joints->group[map] = kiln_sets_root(sets, map);
        }
    kiln_free(&sets);
    return KILN_OK;
}

static void end_search(struct search *s)
{
    kiln_edge_tree_destroy(&s->tree);
    for (size_t i = 0; s->ends != NULL && i < s->scene->mesh_count; i++)
        kiln_free(&s->ends[i]);
    kiln_arena_release(&s->arena);
}

int kiln_joints_find(struct kiln_joints **joints, const struct kiln_scene *scene, const struct kiln_surface *surface,
                     double extent, struct kiln_error *error)
{
    struct search s = {.scene = scene, .surface = surface, .extent = extent};
    int status;
    KILN_TRY(kiln_allocate(joints, 1, sizeof **joints, "joints of objects", error));
    KILN_TRY(
        kiln_arena_allocate(&s.arena, &s.boxes, surface->object_count, sizeof *s.boxes, "the boxes of objects", error));
    KILN_TRY(
        kiln_arena_allocate(&s.arena, &s.clips, surface->object_count, sizeof *s.clips, "the boxes of objects", error));
    KILN_TRY(kiln_arena_allocate(&s.arena, &s.ends, scene->mesh_count, sizeof *s.ends, "where meshes end", error));
    find_boxes(&s);
    KILN_TRY(find_clips(&s, error));
    KILN_TRY(collect_edges(&s, error));
    if (s.edge_count > 0)
        KILN_TRY(find_pairs(&s, error));
    KILN_TRY(make_joints(&s, *joints, error));
end:
    end_search(&s);
    if (status != KILN_OK)
        kiln_joints_destroy(joints);
    return status;
}

void kiln_joints_destroy(struct kiln_joints **joints)
{
    if (*joints == NULL)
        return;
    kiln_free(&(*joints)->joints);
    kiln_free(&(*joints)->group);
    kiln_free(joints);
}
