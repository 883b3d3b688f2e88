#include "worker/backend/embree/light_vertices.h"

#include <math.h>
#include <omp.h>

#include "shaders/shared/color.h"
#include "worker/backend/embree/land.h"
#include "worker/base/memory.h"
#include "worker/light/aims.h"

/* ---- lists ---- */

int light_vertices_add(struct light_vertices *list, const struct light_vertex *vertex, struct kiln_error *error)
{
    const int status = kiln_grow(&list->vertices, &list->capacity, list->count + 1, sizeof *list->vertices,
                                 "vertices of light paths", error);
    if (status != KILN_OK)
        return status;
    list->vertices[list->count++] = *vertex;
    return KILN_OK;
}

static void release(struct light_vertices *list)
{
    kiln_free(&list->vertices);
    kiln_free(&list->up_to);
    list->count = list->capacity = 0;
}

/* Joins the threads' lists, in order, and sums up. */
static int join(struct light_vertices *list, const struct light_vertices *parts, size_t count, struct kiln_error *error)
{
    double sum = 0.0;
    size_t all = 0;
    for (size_t t = 0; t < count; t++)
        all += parts[t].count;
    int status = kiln_allocate(&list->vertices, all, sizeof *list->vertices, "vertices of light paths", error);
    if (status == KILN_OK)
        status = kiln_allocate(&list->up_to, all, sizeof *list->up_to, "vertices of light paths", error);
    for (size_t t = 0; t < count && status == KILN_OK; t++)
        for (size_t i = 0; i < parts[t].count; i++) {
            sum += kiln_luminance_of_floats(parts[t].vertices[i].flux);
            list->vertices[list->count] = parts[t].vertices[i];
            list->up_to[list->count++] = sum;
        }
    return status;
}

/* ---- tracing ---- */

static int trace_quarter(const struct embree_backend *b, const struct kiln_caustic_techniques *t, uint64_t quarter,
                         struct light_vertices *parts, struct light_vertices *list, struct kiln_error *error)
{
    const uint64_t paths = t->kept->paths, first = (t->first_kept + quarter) * paths;
    int status = KILN_OK;
#pragma omp parallel num_threads((int)b->threads)
    {
        const unsigned saved = embree_enter();
        const uint64_t thread = (uint64_t)omp_get_thread_num(), threads = (uint64_t)omp_get_num_threads(),
                       begin = paths * thread / threads, end = paths * (thread + 1) / threads;
        struct kiln_error failure;
        const int done = land_keep(b, t, first + begin, end - begin, &parts[thread], &failure);
        if (done != KILN_OK) {
#pragma omp critical(kiln_light_vertices_status)
            {
                status = done;
                if (error != NULL)
                    *error = failure;
            }
        }
        embree_leave(saved);
    }
    return status == KILN_OK ? join(list, parts, b->threads, error) : status;
}

static int make(struct light_vertex_cache *cache, const struct embree_backend *b,
                const struct kiln_caustic_techniques *t, struct kiln_error *error)
{
    struct light_vertices *parts = NULL;
    int status = kiln_allocate(&parts, b->threads, sizeof *parts, "vertices of light paths", error);
    for (uint64_t q = 0; q < RAY_QUARTERS && status == KILN_OK; q++) {
        cache->of[q].chance = t->connections;
        status = trace_quarter(b, t, q, parts, &cache->of[q], error);
        for (uint32_t i = 0; i < b->threads; i++)
            release(&parts[i]);
    }
    kiln_free(&parts);
    return status;
}

/* What the vertices hang on, within a backend. */
static uint32_t wanted(const struct kiln_caustic_techniques *t)
{
    const struct kiln_aims *aims = t->kept;
    uint32_t hash = kiln_hash2((uint32_t)t->first_kept, (uint32_t)t->iterations);
    hash = kiln_hash2(kiln_hash2(hash, (uint32_t)t->mis), (uint32_t)(t->connections * 0x1p31));
    for (size_t i = 0; i <= aims->count; i++)
        hash = kiln_hash2(hash, (uint32_t)aims->first[i]);
    for (size_t i = 0; i <= aims->count; i++)
        hash = kiln_hash2(hash, (uint32_t)t->aims->first[i]);
    return hash;
}

int light_vertices_want(struct embree_backend *b, const struct kiln_caustic_techniques *t, struct kiln_error *error)
{
    const uint32_t hash = t->kept != NULL ? wanted(t) : 0;
    if (t->kept != NULL && b->light_vertices != NULL && b->light_vertices->wanted == hash)
        return KILN_OK;
    light_vertices_destroy(&b->light_vertices);
    if (t->kept == NULL)
        return KILN_OK;
    int status = kiln_allocate(&b->light_vertices, 1, sizeof *b->light_vertices, "vertices of light paths", error);
    if (status == KILN_OK)
        status = make(b->light_vertices, b, t, error);
    if (status != KILN_OK)
        light_vertices_destroy(&b->light_vertices);
    else
        b->light_vertices->wanted = hash;
    return status;
}

void light_vertices_destroy(struct light_vertex_cache **cache)
{
    if (*cache == NULL)
        return;
    for (uint32_t q = 0; q < RAY_QUARTERS; q++)
        release(&(*cache)->of[q]);
    kiln_free(cache);
}

/* ---- connections ---- */

/* The first vertex up to which there is more than `at`. */
static size_t find(const struct light_vertices *list, double at)
{
    size_t first = 0, end = list->count - 1;
    while (first < end) {
        const size_t middle = first + (end - first) / 2;
        if (list->up_to[middle] > at)
            end = middle;
        else
            first = middle + 1;
    }
    return first;
}

bool light_vertices_pick(const struct light_vertices *list, const struct walk *walk, uint32_t use,
                         struct kiln_vec3 place, struct light_connection *c)
{
    const double all = list->count > 0 ? list->up_to[list->count - 1] : 0.0;
    double pick, rest;
    walk_draw(walk, use, &pick, &rest);
    if (!(all > 0.0) || !(rest < list->chance))
        return false;
    c->light = &list->vertices[find(list, pick * all)];
    c->chance = list->chance * kiln_luminance_of_floats(c->light->flux) / all;
    const struct kiln_vec3 way = vec3_sub(c->light->v.m.position, place);
    c->squared = (double)vec3_dot(way, way);
    if (!(c->squared > 0.0) || !(c->chance > 0.0))
        return false;
    c->direction = vec3_normalize(way);
    return true;
}

bool light_vertices_connect(struct light_connection *c, struct walk *walk, struct kiln_vec3 start)
{
    const struct vertex *v = &c->light->v;
    const struct kiln_vec3 back = vec3_scale(c->direction, -1.0f);
    float body[3] = {1.0f, 1.0f, 1.0f};
    double through[3];
    if (!vertex_scatter(walk->b, v, back, v->from, v->m.others, &c->far))
        return false;
    walk->rays++;
    if (!passage_between(walk->b, walk->context, start, vertex_start(v, back), through))
        return false;
    vertex_attenuate(v, back, (float)sqrt(c->squared), body);
    for (int i = 0; i < 3; i++)
        c->irradiance[i] = (double)c->light->flux[i] / c->chance * c->far.all[i] * c->far.cosine_o / c->squared *
                           through[i] * (double)body[i];
    return true;
}
