#include "worker/backend/vulkan/points.h"

#include <math.h>
#include <omp.h>
#include <string.h>

#include "shaders/shared/layout_point_gloss.h"
#include "shaders/shared/streams.h"
#include "worker/base/clock.h"
#include "worker/base/memory.h"
#include "worker/base/thread.h"
#include "worker/material/surface_bsdf.h"
#include "worker/sampling/keys.h"
#include "worker/scene/footprint.h"

enum { BLOCK_POINTS = 1 << 20, BLOCK_PIECES = 1 << 21 };

static uint64_t pieces_of(const struct kiln_surface *s, size_t tile_run)
{
    return s->piece_base[tile_run + 1] - s->piece_base[tile_run];
}

/* Divides the tile runs [begin, end) into blocks; if `blocks` is NULL, only counts them. */
static size_t cut(const struct kiln_surface *s, size_t begin, size_t end, struct vulkan_point_range *blocks)
{
    size_t count = 0;
    for (size_t f = begin; f < end;) {
        const size_t first = f;
        uint64_t points = 0, pieces = 0;
        while (f < end && (f == first || (points + s->tile_runs[f].count <= BLOCK_POINTS &&
                                          pieces + pieces_of(s, f) <= BLOCK_PIECES))) {
            points += s->tile_runs[f].count;
            pieces += pieces_of(s, f++);
        }
        if (blocks != NULL)
            blocks[count] = (struct vulkan_point_range){.tile_run_first = first,
                                                        .tile_run_count = f - first,
                                                        .first = kiln_own_of_global(s, s->tile_runs[first].first),
                                                        .count = points};
        count++;
    }
    return count;
}

static int make_blocks(struct vulkan_points *p, size_t begin, size_t end, struct kiln_error *error)
{
    p->block_count = cut(p->surface, begin, end, NULL);
    const int status =
        kiln_allocate(&p->blocks, p->block_count, sizeof *p->blocks, "the device's blocks of points", error);
    if (status == KILN_OK)
        (void)cut(p->surface, begin, end, p->blocks);
    return status;
}

int vulkan_points_create(struct vulkan_points **points, struct gpu *gpu, const struct kiln_backend_params *params,
                         const struct kiln_surface *surface, const struct vulkan_materials *materials,
                         struct kiln_error *error)
{
    int status = kiln_allocate(points, 1, sizeof **points, "the device's points", error);
    if (status != KILN_OK)
        return status;
    struct vulkan_points *p = *points;
    p->gpu = gpu;
    p->params = params;
    p->surface = surface;
    p->materials = materials;
    p->threads = params->threads != 0 ? params->threads : (uint32_t)omp_get_num_procs();
    for (size_t i = 0; i < params->scene->mesh_count; i++)
        p->smooth = p->smooth || (params->scene->meshes[i].flags & KILN_MESH_SMOOTH) != 0;
    status = make_blocks(p, 0, surface->tile_run_count, error);
    if (status != KILN_OK)
        vulkan_points_destroy(points);
    return status;
}

/* Prepares points of other ranks, whose blocks are made in the workspace of `own`. */
int vulkan_points_of_others(struct vulkan_points **points, struct vulkan_points *own, const struct kiln_others *others,
                            struct kiln_error *error)
{
    int status = kiln_allocate(points, 1, sizeof **points, "the device's points of another rank", error);
    if (status != KILN_OK)
        return status;
    **points = (struct vulkan_points){.gpu = own->gpu,
                                      .params = own->params,
                                      .surface = others->surface,
                                      .materials = own->materials,
                                      .idle = own,
                                      .threads = own->threads,
                                      .workspace = own->workspace,
                                      .smooth = own->smooth};
    own->workspace = NULL;
    status = make_blocks(*points, others->first, others->first + others->count, error);
    if (status != KILN_OK)
        vulkan_points_destroy(points);
    return status;
}

static void workspace_destroy(struct points_workspace **workspace);
static void ahead_destroy(struct points_ahead **ahead);

static void forget_lists(struct vulkan_points *p, struct vulkan_point_range *block)
{
    gpu_buffer_destroy(p->gpu, &block->list);
    gpu_buffer_destroy(p->gpu, &block->asked_list);
    kiln_free(&block->buried);
    kiln_free(&block->asked);
    block->buried_count = block->asked_count = 0;
}

static void release(struct vulkan_points *p, struct vulkan_point_range *block)
{
    gpu_buffer_destroy(p->gpu, &block->points);
    gpu_buffer_destroy(p->gpu, &block->parts);
    gpu_buffer_destroy(p->gpu, &block->states);
    forget_lists(p, block);
    gpu_buffer_destroy(p->gpu, &block->near_probes);
    block->resident = block->states_known = false;
}

void vulkan_points_destroy(struct vulkan_points **points)
{
    struct vulkan_points *p = *points;
    if (p == NULL)
        return;
    ahead_destroy(&p->ahead);
    for (size_t i = 0; p->blocks != NULL && i < p->block_count; i++)
        release(p, &p->blocks[i]);
    kiln_free(&p->blocks);
    if (p->idle != NULL) {
        p->idle->workspace = p->workspace;
        p->idle->seconds += p->seconds;
        p->idle->brought += p->brought;
    } else {
        workspace_destroy(&p->workspace);
    }
    kiln_free(points);
}

void vulkan_points_forget_probes(struct vulkan_points *points)
{
    for (size_t i = 0; i < points->block_count; i++)
        gpu_buffer_destroy(points->gpu, &points->blocks[i].near_probes);
}

void vulkan_points_forget_states(struct vulkan_points *points)
{
    for (size_t i = 0; i < points->block_count; i++)
        points->blocks[i].states_known = false;
}

/* Marks the states of blocks with an item of the batch (NULL: all blocks) for recomputation. */
static void forget_states_of(struct vulkan_points *points, const struct kiln_batch *batch)
{
    for (size_t i = 0; batch != NULL && i < points->block_count; i++) {
        struct vulkan_point_range *b = &points->blocks[i];
        if (b->tile_run_first < batch->first + batch->count && batch->first < b->tile_run_first + b->tile_run_count)
            b->states_known = false;
    }
}

void vulkan_points_choose(struct vulkan_points *points, const struct kiln_batch *batch, bool mixed)
{
    forget_states_of(points, points->chosen);
    points->mixed = mixed;
    points->chosen = batch != NULL && (batch->samples_each != NULL || batch->selections != NULL) ? batch : NULL;
    forget_states_of(points, points->chosen);
}

/* Parts made by one thread, in an array of its own. */
struct part_list {
    struct kiln_gpu_piece *at;
    size_t count, room;
    size_t offset; /* their offset in the block's array */
};

struct points_workspace {
    struct kiln_gpu_point *points;
    size_t point_room;
    uint16_t *thread_of; /* of a tile run */
    size_t tile_run_room;
    uint32_t threads;
    struct part_list lists[]; /* one a thread */
};

/* A range being made. */
struct maker {
    const struct vulkan_points *p;
    const struct vulkan_point_range *block;
    struct points_workspace *w;
    size_t part_count;
};

static void workspace_destroy(struct points_workspace **workspace)
{
    if (*workspace == NULL)
        return;
    for (uint32_t t = 0; t < (*workspace)->threads; t++)
        kiln_free(&(*workspace)->lists[t].at);
    kiln_free(&(*workspace)->points);
    kiln_free(&(*workspace)->thread_of);
    kiln_free(workspace);
}

/* Cached data of a triangle, for further points on it. */
struct known {
    bool back; /* a back: the normal is flipped */
    uint32_t triangle;
    struct kiln_vec3 normal;
    float offset;
    bool lifts; /* rays are lifted off it */
    struct kiln_lift lift;
};

static void know(struct known *k, const struct maker *m, uint32_t triangle)
{
    if (k->triangle == triangle)
        return;
    k->triangle = triangle;
    const struct kiln_vec3 front = kiln_triangle_exact_normal(m->p->params->scene, m->p->params->geometry, triangle);
    k->normal = k->back ? vec3_scale(front, -1.0f) : front;
    k->offset = kiln_offset_distance(m->p->params->geometry, triangle, k->normal);
    const struct kiln_scene *scene = m->p->params->scene;
    const uint32_t mesh = scene->objects[m->p->params->geometry->records[triangle].object].mesh;
    k->lifts = (scene->meshes[mesh].flags & KILN_MESH_SMOOTH) != 0 &&
               kiln_triangle_lift(scene, m->p->params->geometry, triangle, k->back, &k->lift);
    if (!k->lifts)
        k->lift = (struct kiln_lift){{0.0f}};
}

static struct kiln_gpu_piece part_of(const struct maker *m, struct known *k, const struct kiln_footprint_triangle *from)
{
    struct kiln_vec3 corner[3];
    kiln_geometry_corners(m->p->params->geometry, from->triangle, corner);
    know(k, m, from->triangle);
    const struct kiln_dvec3 c0 = dvec3_of(corner[0]), e1 = dvec3_sub(dvec3_of(corner[1]), c0),
                            e2 = dvec3_sub(dvec3_of(corner[2]), c0);
    struct kiln_dvec3 at[3];
    for (int c = 0; c < 3; c++)
        at[c] = dvec3_add(dvec3_scale(e1, from->b1[c]), dvec3_scale(e2, from->b2[c]));
    const struct kiln_dvec3 off = dvec3_scale(dvec3_of(k->normal), (double)k->offset);
    return (struct kiln_gpu_piece){.p = vec3_of(dvec3_add(dvec3_add(c0, at[0]), off)),
                                   .e1 = vec3_of(dvec3_sub(at[1], at[0])),
                                   .e2 = vec3_of(dvec3_sub(at[2], at[0])),
                                   .normal = k->normal,
                                   .until = (float)from->until,
                                   .offset = k->offset};
}

/* The box about a point's parts. */
struct box {
    struct kiln_vec3 low, high;
};

static void box_add(struct box *box, struct kiln_vec3 p)
{
    box->low = vec3(fminf(box->low.x, p.x), fminf(box->low.y, p.y), fminf(box->low.z, p.z));
    box->high = vec3(fmaxf(box->high.x, p.x), fmaxf(box->high.y, p.y), fmaxf(box->high.z, p.z));
}

/* Finds the triangles of piece i; `already`: number of triangles of earlier pieces. */
static uint32_t triangles_of(const struct kiln_footprint *f, uint32_t i, size_t already,
                             struct kiln_footprint_triangle triangles[KILN_FOOTPRINT_TRIANGLES])
{
    const uint32_t count = kiln_footprint_triangles(f, i, triangles);
    if (count != 0 || i + 1 != f->piece_count || already != 0)
        return count;
    /* clipping left nothing of the point: use a single position */
    triangles[0] = (struct kiln_footprint_triangle){.triangle = f->pieces[0], .until = 1.0};
    return 1;
}

static int make_parts(struct maker *m, struct part_list *list, struct known *k, const struct kiln_footprint *f,
                      struct kiln_gpu_point *point, struct kiln_error *error)
{
    struct box box = {vec3(INFINITY, INFINITY, INFINITY), vec3(-INFINITY, -INFINITY, -INFINITY)};
    bool one_normal = true;
    point->flags |= KILN_GPU_POINT_PARTIAL;
    point->first_piece = (uint32_t)list->count;
    for (uint32_t i = 0; i < f->piece_count; i++) {
        struct kiln_footprint_triangle parts[KILN_FOOTPRINT_TRIANGLES];
        const uint32_t count = triangles_of(f, i, list->count - point->first_piece, parts);
        const int status =
            kiln_grow(&list->at, &list->room, list->count + count, sizeof *list->at, "the parts of points", error);
        if (status != KILN_OK)
            return status;
        for (uint32_t j = 0; j < count; j++) {
            const struct kiln_gpu_piece part = part_of(m, k, &parts[j]);
            box_add(&box, part.p);
            box_add(&box, vec3_add(part.p, part.e1));
            box_add(&box, vec3_add(part.p, part.e2));
            one_normal = one_normal && vec3_dot(point->normal, part.normal) >= 0.99999f;
            list->at[list->count++] = part;
        }
    }
    point->part_count = (uint32_t)(list->count - point->first_piece);
    point->centre = vec3_scale(vec3_add(box.low, box.high), 0.5f);
    point->spread = 0.5f * vec3_length(vec3_sub(box.high, box.low));
    point->flags |= one_normal ? KILN_GPU_POINT_ONE_NORMAL : 0;
    return KILN_OK;
}

static void make_whole(const struct known *k, const struct kiln_footprint *f, struct kiln_gpu_point *point)
{
    const struct kiln_footprint_extent extent = kiln_footprint_extent(f);
    point->centre = extent.centre;
    point->spread = extent.spread;
    point->flags |= KILN_GPU_POINT_ONE_NORMAL;
    point->origin = vec3_madd(f->whole.origin, k->normal, k->offset);
    point->edge_s = f->whole.du;
    point->edge_t = f->whole.dv;
}

static struct kiln_gpu_piece_triangle part_triangle_of(const struct kiln_footprint_triangle *from)
{
    const double *b1 = from->b1, *b2 = from->b2;
    return (struct kiln_gpu_piece_triangle){.triangle = from->triangle,
                                            .weight = {(float)b1[0], (float)b2[0]},
                                            .along_e1 = {(float)(b1[1] - b1[0]), (float)(b2[1] - b2[0])},
                                            .along_e2 = {(float)(b1[2] - b1[0]), (float)(b2[2] - b2[0])}};
}

static struct kiln_gpu_piece_triangle whole_triangle_of(const struct kiln_footprint *f)
{
    return (struct kiln_gpu_piece_triangle){.triangle = f->pieces[0],
                                            .weight = {f->whole.b[0], f->whole.b[1]},
                                            .along_e1 = {f->whole.b_du[0], f->whole.b_du[1]},
                                            .along_e2 = {f->whole.b_dv[0], f->whole.b_dv[1]}};
}

static void add_part_triangle(const struct maker *m, struct known *k, struct part_list *list,
                              struct kiln_gpu_piece_triangle from)
{
    know(k, m, from.triangle);
    memcpy(from.lift, k->lift.at, sizeof from.lift);
    memcpy(&list->at[list->count++], &from, sizeof from);
}

static bool is_lifted(const struct maker *m, struct known *k, const struct kiln_footprint *f)
{
    bool lifted = false;
    for (uint32_t i = 0; i < f->piece_count && !lifted; i++) {
        know(k, m, f->pieces[i]);
        lifted = k->lifts;
    }
    return lifted;
}

/* Makes a point's triangles. Memory order: its parts, its mask (NULL: none), the mask's triangles. */
static int make_triangles(const struct maker *m, struct part_list *list, struct known *k,
                          const struct kiln_footprint *f, struct kiln_gpu_point *point, const struct kiln_mask *mask,
                          struct kiln_error *error)
{
    const size_t triangles = f->kind == KILN_FOOTPRINT_WHOLE ? 1 : point->part_count;
    const int status =
        kiln_grow(&list->at, &list->room, list->count + 1 + triangles, sizeof *list->at, "the parts of points", error);
    if (status != KILN_OK)
        return status;
    if ((point->flags & KILN_GPU_POINT_PARTIAL) == 0)
        point->first_piece = (uint32_t)list->count;
    if (mask != NULL) {
        struct kiln_gpu_mask to = {.count = mask->count, .most = mask->most};
        point->flags |= KILN_GPU_POINT_MASKED;
        memcpy(to.cells, mask->cells, sizeof to.cells);
        memcpy(&list->at[list->count++], &to, sizeof to);
    }
    const size_t first = list->count;
    if (f->kind == KILN_FOOTPRINT_WHOLE)
        add_part_triangle(m, k, list, whole_triangle_of(f));
    for (uint32_t i = 0; f->kind != KILN_FOOTPRINT_WHOLE && i < f->piece_count; i++) {
        struct kiln_footprint_triangle of_piece[KILN_FOOTPRINT_TRIANGLES];
        const uint32_t count = triangles_of(f, i, list->count - first, of_piece);
        for (uint32_t j = 0; j < count; j++)
            add_part_triangle(m, k, list, part_triangle_of(&of_piece[j]));
    }
    return KILN_OK;
}

/* For a material with gloss, stores before the point's parts how much light the point takes up. */
static int make_gloss(const struct maker *m, struct part_list *list, const struct kiln_footprint *f, bool back,
                      struct kiln_gpu_point *point, struct kiln_error *error)
{
    const struct kiln_scene *scene = m->p->params->scene;
    const struct kiln_geometry *g = m->p->params->geometry;
    uint32_t triangle;
    float b1, b2, s1, s2;
    kiln_footprint_sample(f, 0.5f, 0.5f, &triangle, &b1, &b2);
    const struct kiln_hit_record *record = &g->records[triangle];
    const struct kiln_gloss *gloss = kiln_gloss_taken(scene, record->material & KILN_RECORD_MATERIAL);
    if (gloss == NULL)
        return KILN_OK;
    const int status = kiln_grow(&list->at, &list->room, list->count + KILN_GPU_POINT_GLOSS_PIECES, sizeof *list->at,
                                 "the parts of points", error);
    if (status != KILN_OK)
        return status;
    kiln_geometry_stored_barycentrics(scene, g, triangle, b1, b2, &s1, &s2);
    const struct kiln_bsdf_lobes l = kiln_surface_lobes(
        scene, &m->p->materials->lobes[record->material & KILN_RECORD_MATERIAL],
        &scene->meshes[scene->objects[record->object].mesh], g->stored_triangle[triangle], s1, s2, false);
    const struct kiln_gpu_point_gloss own = {.model = l.p.model,
                                             .matt = l.matt,
                                             .specular = l.p.specular,
                                             .color = kiln_bsdf_largest(l.p.specular_color),
                                             .face = l.face,
                                             .coat = kiln_bsdf_coated(l, !back) ? l.coat.strength : 0.0f,
                                             .coat_face = l.coat.face};
    _Static_assert(sizeof own == KILN_GPU_POINT_GLOSS_PIECES * sizeof(struct kiln_gpu_piece), "parts of a point");
    memcpy(&list->at[list->count], &own, sizeof own);
    list->count += KILN_GPU_POINT_GLOSS_PIECES;
    point->first_piece = (uint32_t)list->count;
    point->flags |= KILN_GPU_POINT_GLOSS;
    return KILN_OK;
}

static int make_point(struct maker *m, struct part_list *list, struct known *k, const struct kiln_point_cursor *at,
                      uint32_t tile_key, bool smooth, struct kiln_gpu_point *point, struct kiln_error *error)
{
    const struct kiln_surface *s = m->p->surface;
    const struct kiln_backend_params *params = m->p->params;
    const uint64_t texel = (uint64_t)at->y * s->lightmaps[at->map].width + at->x;
    struct kiln_footprint f;
    kiln_footprint_prepare(&f, params->scene, params->geometry, s, at);
    know(k, m, f.pieces[0]);
    *point = (struct kiln_gpu_point){.normal = k->normal,
                                     .shading = k->normal,
                                     .offset = k->offset,
                                     .tile_key = tile_key,
                                     .key = kiln_texel_key(kiln_seed_key(params->seed), at->map, texel)};
    struct kiln_mask mask;
    point->present = kiln_footprint_opacity(&f, kiln_texel_key(KILN_LOOKS_KEY, at->map, texel), &mask);
    if (smooth) {
        struct kiln_vec3 mean;
        kiln_footprint_normals(&f, &mean, &point->shading);
        point->flags |= KILN_GPU_POINT_SMOOTH;
    }
    if ((params->scene->objects[kiln_map_object(s, at->map)].flags & KILN_OBJECT_RECEIVER_ONLY) != 0)
        point->flags |= KILN_GPU_POINT_RECEIVES_ONLY;
    int status = params->scene->taken != NULL ? make_gloss(m, list, &f, at->back, point, error) : KILN_OK;
    if (status != KILN_OK)
        return status;
    if (f.kind != KILN_FOOTPRINT_WHOLE)
        status = make_parts(m, list, k, &f, point, error);
    else
        make_whole(k, &f, point);
    const bool lifted = smooth && is_lifted(m, k, &f);
    if (lifted) {
        point->flags |= KILN_GPU_POINT_LIFTED;
        point->flags &= ~KILN_GPU_POINT_ONE_NORMAL; /* light from below it may count */
    }
    if (status == KILN_OK && (lifted || mask.count != 0))
        status = make_triangles(m, list, k, &f, point, mask.count != 0 ? &mask : NULL, error);
    return status;
}

static int make_tile_run(struct maker *m, struct part_list *list, struct known *k, size_t tile_run,
                         struct kiln_error *error)
{
    const struct kiln_surface *s = m->p->surface;
    const struct kiln_scene *scene = m->p->params->scene;
    const struct kiln_tile_run *f = &s->tile_runs[tile_run];
    const bool smooth = (scene->meshes[scene->objects[kiln_map_object(s, f->map)].mesh].flags & KILN_MESH_SMOOTH) != 0;
    const uint32_t tile_key = kiln_tile_key(kiln_seed_key(m->p->params->seed), f->map, f->tile);
    struct kiln_point_cursor at = kiln_point_first(s, tile_run);
    int status = KILN_OK;
    if (k->back != at.back)
        *k = (struct known){.back = at.back, .triangle = KILN_NONE};
    for (uint32_t i = 0; i < f->count && status == KILN_OK; i++, kiln_point_next(s, &at))
        status = make_point(m, list, k, &at, tile_key, smooth, &m->w->points[at.point.at - m->block->first.at], error);
    return status;
}

/* Each thread's points and parts. */
static int make_all(struct maker *m, struct kiln_error *error)
{
    const struct vulkan_point_range *block = m->block;
    int status = KILN_OK;
#pragma omp parallel num_threads((int)m->w->threads)
    {
        const int thread = omp_get_thread_num();
        struct known k = {.triangle = KILN_NONE};
        struct kiln_error own;
        int mine = KILN_OK;
#pragma omp for schedule(dynamic, 16)
        for (size_t f = 0; f < block->tile_run_count; f++) {
            m->w->thread_of[f] = (uint16_t)thread;
            if (mine == KILN_OK)
                mine = make_tile_run(m, &m->w->lists[thread], &k, block->tile_run_first + f, &own);
        }
        if (mine != KILN_OK) {
#pragma omp critical(kiln_make_points)
            status = kiln_fail(error, mine, "%s", own.message);
        }
    }
    return status;
}

/* Tells the points the final offsets of their parts, thread after thread. */
static void place_parts(struct maker *m)
{
    struct points_workspace *w = m->w;
    const struct kiln_tile_run *tile_runs = m->p->surface->tile_runs + m->block->tile_run_first;
    for (uint32_t t = 0; t < w->threads; t++) {
        w->lists[t].offset = m->part_count;
        m->part_count += w->lists[t].count;
    }
#pragma omp parallel for num_threads((int)w->threads) schedule(static)
    for (size_t f = 0; f < m->block->tile_run_count; f++) {
        struct kiln_gpu_point *points = w->points + (tile_runs[f].first.at - tile_runs[0].first.at);
        for (uint32_t i = 0; i < tile_runs[f].count; i++)
            points[i].first_piece += (uint32_t)w->lists[w->thread_of[f]].offset;
    }
}

static int make_workspace(struct points_workspace **workspace, const struct vulkan_points *p,
                          const struct vulkan_point_range *block, struct kiln_error *error)
{
    int status = KILN_OK;
    if (*workspace == NULL) {
        KILN_TRY(kiln_allocate(workspace, 1, sizeof **workspace + p->threads * sizeof(struct part_list),
                               "what points are made in", error));
        (*workspace)->threads = p->threads;
    }
    struct points_workspace *w = *workspace;
    KILN_TRY(kiln_grow(&w->points, &w->point_room, block->count, sizeof *w->points, "a block of points", error));
    KILN_TRY(kiln_grow(&w->thread_of, &w->tile_run_room, block->tile_run_count, sizeof *w->thread_of,
                       "a block's tile runs", error));
end:
    return status;
}

static int fill(struct maker *m, struct kiln_error *error)
{
    for (uint32_t t = 0; t < m->w->threads; t++)
        m->w->lists[t].count = 0;
    const int status = make_all(m, error);
    if (status == KILN_OK)
        place_parts(m);
    return status;
}

/* ---- the next block ---- */

/* A block made by a thread ahead of time, in a workspace of its own. */
struct points_ahead {
    pthread_t thread;
    bool runs;
    const struct vulkan_point_range *block; /* NULL: there is none */
    struct maker maker;
    struct points_workspace *workspace;
    int status;
    struct kiln_error error;
};

static void *make_ahead(void *context)
{
    struct points_ahead *a = context;
    const struct vulkan_points *p = a->maker.p;
    a->status = make_workspace(&a->workspace, p, a->block, &a->error);
    a->maker.w = a->workspace;
    if (a->status == KILN_OK)
        a->status = fill(&a->maker, &a->error);
    return NULL;
}

static void end_ahead(struct points_ahead *a)
{
    if (a != NULL && a->runs)
        (void)pthread_join(a->thread, NULL);
    if (a != NULL)
        a->runs = false;
}

static void ahead_destroy(struct points_ahead **ahead)
{
    end_ahead(*ahead);
    if (*ahead != NULL)
        workspace_destroy(&(*ahead)->workspace);
    kiln_free(ahead);
}

/* Begins to make the next block, which is likely to be needed next. If there is no thread or memory for it, it is made
 * when needed. */
static void begin_ahead(struct vulkan_points *p, const struct vulkan_point_range *block)
{
    const struct vulkan_point_range *next = block + 1;
    if (next == p->blocks + p->block_count || next->resident) {
        ahead_destroy(&p->ahead);
        return;
    }
    if (p->ahead == NULL && kiln_allocate(&p->ahead, 1, sizeof *p->ahead, "what points are made in", NULL) != KILN_OK)
        return;
    end_ahead(p->ahead);
    p->ahead->block = next;
    p->ahead->maker = (struct maker){.p = p, .block = next};
    p->ahead->runs = kiln_thread_start(&p->ahead->thread, make_ahead, p->ahead);
    if (!p->ahead->runs)
        p->ahead->block = NULL;
}

/* Gets the block's points in p->workspace: those made ahead of time, or makes them now. */
static int make_block(struct vulkan_points *p, const struct vulkan_point_range *block, struct maker *m,
                      struct kiln_error *error)
{
    struct points_ahead *a = p->ahead;
    end_ahead(a);
    if (a != NULL && a->block == block && a->status == KILN_OK) {
        struct points_workspace *const made = a->workspace;
        a->workspace = p->workspace;
        p->workspace = made;
        a->block = NULL;
        *m = a->maker;
        return KILN_OK;
    }
    int status = make_workspace(&p->workspace, p, block, error);
    *m = (struct maker){.p = p, .block = block, .w = p->workspace};
    if (status == KILN_OK)
        status = fill(m, error);
    return status;
}

/* Frees the least recently used block, if last used before `since`; false: none. */
static bool make_way(struct vulkan_points *p, uint64_t since)
{
    struct vulkan_point_range *oldest = NULL;
    for (size_t i = 0; i < p->block_count; i++) {
        struct vulkan_point_range *b = &p->blocks[i];
        if (b->resident && b->last_used < since && (oldest == NULL || b->last_used < oldest->last_used))
            oldest = b;
    }
    if (oldest != NULL)
        release(p, oldest);
    return oldest != NULL;
}

/* Memory left for the passes' own buffers. */
enum { RESERVE = 192 << 20 };

static int upload(struct vulkan_points *p, struct vulkan_point_range *block, const struct maker *m,
                  struct kiln_error *error)
{
    int status;
    KILN_TRY(gpu_buffer_of(p->gpu, &block->points, m->w->points, block->count * sizeof *m->w->points,
                           "a block of points", error));
    KILN_TRY(gpu_buffer_create(p->gpu, &block->parts, m->part_count * sizeof(struct kiln_gpu_piece), GPU_DEVICE,
                               "the parts of a block of points", error));
    for (uint32_t t = 0; t < m->w->threads; t++) {
        const struct part_list *list = &m->w->lists[t];
        KILN_TRY(gpu_fill(p->gpu, &block->parts, list->offset * sizeof *list->at, list->at,
                          list->count * sizeof *list->at, error));
    }
    KILN_TRY(gpu_buffer_create(p->gpu, &block->states, block->count * sizeof(uint32_t), GPU_DEVICE,
                               "the states of a block of points", error));
end:
    return status;
}

static int bring(struct vulkan_points *p, struct vulkan_point_range *block, uint64_t since, struct kiln_error *error)
{
    const double start = kiln_clock_seconds();
    struct maker m;
    int status;
    KILN_TRY(make_block(p, block, &m, error));
    begin_ahead(p, block);
    const uint64_t words = p->surface->near_probes != NULL ? 3 : 2;
    const uint64_t wanted = block->count * (sizeof(struct kiln_gpu_point) + words * sizeof(uint32_t)) +
                            m.part_count * sizeof(struct kiln_gpu_piece) + RESERVE;
    while (gpu_memory_left(p->gpu) < wanted &&
           (make_way(p, since) || (p->idle != NULL && make_way(p->idle, UINT64_MAX))))
        ;
    KILN_TRY(upload(p, block, &m, error));
end:
    block->resident = true; /* set also if only a part was loaded: release frees it */
    p->seconds += kiln_clock_seconds() - start;
    p->brought += block->count;
    if (status != KILN_OK)
        release(p, block);
    return status;
}

static uint32_t state_of(uint16_t visible)
{
    return visible == 0 ? KILN_GPU_STATE_INVALID : visible == 0xffff ? KILN_GPU_STATE_VALID : KILN_GPU_STATE_BURIED;
}

/* Computes the state word of each of the block's points. */
static void find_states(const struct vulkan_points *p, const struct vulkan_point_range *block, uint32_t *states)
{
    const struct kiln_surface *s = p->surface;
    const struct kiln_batch *chosen = p->chosen;
#pragma omp parallel for num_threads((int)vulkan_light_threads(p->threads))
    for (size_t f = block->tile_run_first; f < block->tile_run_first + block->tile_run_count; f++) {
        const uint64_t first = kiln_own_of_global(s, s->tile_runs[f].first).at;
        const bool known = chosen != NULL && f >= chosen->first && f < chosen->first + chosen->count,
                   left_out = known && kiln_batch_leaves_out(chosen, f);
        const bool has_number = known && p->mixed && chosen->samples_each != NULL;
        const uint32_t samples = has_number ? chosen->samples_each[f - chosen->first] : 0;
        const uint64_t points = left_out ? 0 : known ? kiln_batch_points(chosen, f) : UINT64_MAX;
        for (uint32_t k = 0; k < s->tile_runs[f].count; k++) {
            const uint32_t state = (points >> k & 1u) != 0 ? state_of(s->visible[first + k]) : KILN_GPU_STATE_INVALID;
            states[first + k - block->first.at] = state | samples << KILN_GPU_STATE_SAMPLES_SHIFT;
        }
    }
}

/* Lists the block's points that have one of two states, on the host and on the device. */
static int list_points(struct vulkan_points *p, const struct vulkan_point_range *block, const uint32_t *states,
                       uint32_t one, uint32_t other, uint32_t **list, uint32_t *count, struct gpu_buffer *buffer,
                       struct kiln_error *error)
{
    uint32_t found = 0;
    for (uint64_t i = 0; i < block->count; i++)
        found += (states[i] & KILN_GPU_STATE_MASK) == one || (states[i] & KILN_GPU_STATE_MASK) == other;
    const int status = kiln_allocate(list, found, sizeof **list, "a list of points", error);
    if (status != KILN_OK)
        return status;
    *count = found;
    for (uint32_t i = 0, n = 0; n < found; i++)
        if ((states[i] & KILN_GPU_STATE_MASK) == one || (states[i] & KILN_GPU_STATE_MASK) == other)
            (*list)[n++] = i;
    return gpu_buffer_of(p->gpu, buffer, *list, found * sizeof **list, "a list of points", error);
}

static int bring_states(struct vulkan_points *p, struct vulkan_point_range *block, struct kiln_error *error)
{
    uint32_t *states = NULL;
    forget_lists(p, block);
    int status;
    KILN_TRY(kiln_allocate(&states, block->count, sizeof *states, "the states of a block of points", error));
    find_states(p, block, states);
    KILN_TRY(gpu_fill(p->gpu, &block->states, 0, states, block->count * sizeof *states, error));
    KILN_TRY(list_points(p, block, states, KILN_GPU_STATE_BURIED, KILN_GPU_STATE_BURIED, &block->buried,
                         &block->buried_count, &block->list, error));
    if (p->chosen != NULL && p->chosen->selections != NULL)
        KILN_TRY(list_points(p, block, states, KILN_GPU_STATE_VALID, KILN_GPU_STATE_BURIED, &block->asked,
                             &block->asked_count, &block->asked_list, error));
end:
    block->states_known = status == KILN_OK;
    kiln_free(&states);
    return status;
}

static int bring_probes(struct vulkan_points *p, struct vulkan_point_range *block, struct kiln_error *error)
{
    const uint32_t *words = p->surface->near_probes;
    if (words == NULL || block->near_probes.size > 0)
        return KILN_OK;
    return gpu_buffer_of(p->gpu, &block->near_probes, words + block->first.at, block->count * sizeof *words,
                         "which probes a block of points sees", error);
}

int vulkan_points_ready(struct vulkan_points *points, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; i < points->block_count && status == KILN_OK; i++)
        if (points->blocks[i].resident && !points->blocks[i].states_known)
            status = bring_states(points, &points->blocks[i], error);
    return status;
}

int vulkan_points_range(struct vulkan_points *points, size_t tile_run, bool states, uint32_t in_use,
                        struct vulkan_point_range **block, struct kiln_error *error)
{
    size_t low = 0, high = points->block_count - 1;
    while (low < high) { /* find the last block that begins at or before the tile run */
        const size_t middle = high - (high - low) / 2;
        if (points->blocks[middle].tile_run_first <= tile_run)
            low = middle;
        else
            high = middle - 1;
    }
    struct vulkan_point_range *b = &points->blocks[low];
    const uint64_t since = points->clock < in_use ? 0 : points->clock - in_use + 1;
    b->last_used = ++points->clock;
    int status;
    KILN_TRY(b->resident ? KILN_OK : bring(points, b, since, error));
    if (states && !b->states_known)
        KILN_TRY(bring_states(points, b, error));
    KILN_TRY(bring_probes(points, b, error));
end:
    *block = b;
    return status;
}
