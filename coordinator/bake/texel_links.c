#include "coordinator/bake/texel_links.h"

#include <math.h>
#include <stdlib.h>

#include "coordinator/bake/settings/light_settings.h"
#include "coordinator/bake/prepare/materials.h"
#include "coordinator/bake/prepare/prepare.h"
#include "coordinator/bake/identity/transport_identity.h"
#include "coordinator/files/folder.h"
#include "coordinator/files/temporary.h"
#include "coordinator/integrate/patches/patches.h"
#include "coordinator/view/texel_place.h"
#include "worker/base/memory.h"
#include "worker/pass/link_factors.h"

/* Prepared bake, with its links. */
struct work {
    struct kiln_job *job;
    json_t *index;
    struct kiln_temporary temporary;
    struct kiln_prepared *prepared;
    struct kiln_folder folder;
    struct kiln_transport transport;
    struct kiln_patches *patches;
    uint64_t *radiosity;
    const struct kiln_links_parameters *parameters;
    struct kiln_found_links found;
};

static int refuse_unkept(const char *directory, struct kiln_error *error)
{
    return kiln_fail(error, KILN_NO_INPUT,
                     "the bake in %.500s has kept no links: bake with --method radiosity --patches links "
                     "--keep-transport links",
                     directory);
}

/* The options of the bake, and its scene. */
static int take_job(struct work *w, const char *directory, struct kiln_error *error)
{
    int status = kiln_transport_index_read(&w->index, directory, error);
    if (status == KILN_NO_INPUT)
        return refuse_unkept(directory, error);
    if (status != KILN_OK)
        return status;
    char *arguments[] = {"kiln", "bake", "scene", "-o", (char *)(uintptr_t)directory, NULL};
    KILN_TRY(kiln_job_parse(&w->job, 5, arguments, error));
    /* set here and not as an argument, which could be of another kind, or a job file */
    KILN_TRY(kiln_transport_scene_take(w->job, w->index, directory, error));
    KILN_TRY(kiln_transport_options_take(w->job, w->index, directory, error));
    KILN_TRY(kiln_transport_changes_take(w->job, w->index, directory, error));
    if (!kiln_job_has_links(w->job))
        KILN_TRY(refuse_unkept(directory, error));
end:
    return status;
}

/* Prepares the surface, and checks that the links still belong to it. */
static int prepare(struct work *w, const char *directory, struct kiln_error *error)
{
    struct kiln_phases phases = {0};
    int status = kiln_temporary_make(&w->temporary, error);
    if (status == KILN_OK)
        status = kiln_prepare(&w->prepared, MPI_COMM_SELF, w->job, w->temporary.scene_file, &phases, NULL, NULL, error);
    if (status != KILN_OK)
        return status;
    kiln_materials_settle(w->job, w->prepared->scene);
    json_t *now = kiln_transport_identity(w->job, w->prepared);
    status = now != NULL ? kiln_transport_compare(json_object_get(w->index, "identity"), now, directory, error)
                         : kiln_fail(error, KILN_SYSTEM, "out of memory: the transport");
    if (status == KILN_OK)
        status = kiln_folder_open(&w->folder, directory, "transport", false, error);
    w->transport = (struct kiln_transport){.is_on = true,
                                           .replays = true,
                                           .of_links = true,
                                           .folder = w->folder.descriptor,
                                           .directory = w->folder.path,
                                           .key = kiln_transport_key(now),
                                           .points = w->prepared->surface->point_count};
    json_decref(now);
    return status;
}

/* Reads the tree of patches and the kept links. Neither depends on light. */
static int read_links(struct work *w, struct kiln_error *error)
{
    const struct kiln_prepared *p = w->prepared;
    const struct kiln_integrate_settings settings = kiln_light_settings(w->job, p->lights, p->surface->point_count);
    const struct kiln_patches_source source = {.communicator = MPI_COMM_SELF,
                                               .ranks = 1,
                                               .surface = p->surface,
                                               .backend = p->backend,
                                               .settings = &settings,
                                               .replayed = &w->transport};
    const struct kiln_step step = {
        .bounce = 1,
        .stream = 1,
        .samples = kiln_links_samples(settings.patches->link_error, w->job->light.samples_indirect)};
    const void *parameters = NULL;
    int status;
    KILN_TRY(kiln_allocate(&w->radiosity, (size_t)p->surface->point_count, sizeof *w->radiosity,
                           "the radiosity of all points", error));
    KILN_TRY(kiln_patches_create(&w->patches, &source, error));
    KILN_TRY(kiln_patches_update(w->patches, w->radiosity, &step, &parameters, error));
end:
    w->parameters = parameters;
    return status;
}

/* ---- the texel whose links are listed ---- */

static int find_point(const struct kiln_prepared *p, const char *texel, uint64_t *point, struct kiln_error *error)
{
    const struct kiln_surface *s = p->surface;
    struct kiln_texel_place at;
    const int status = kiln_texel_place_read(&at, p->scene, texel, error);
    if (status != KILN_OK)
        return status;
    if (s->bricks != NULL)
        return kiln_fail(error, KILN_USAGE, "--texel %.100s: a bake with --store octree has no texels", texel);
    const struct kiln_lightmap *map = &s->lightmaps[at.object];
    if (at.x >= map->width || at.y >= map->height)
        return kiln_fail(error, KILN_USAGE, "--texel %.100s: that lightmap has %u x %u texels, counted from 0,0", texel,
                         map->width, map->height);
    *point = kiln_surface_find(s, at.object, at.x, at.y).at;
    return *point != KILN_NO_POINT ? KILN_OK : kiln_texel_place_refuse(texel, error);
}

/* The tile run that has the point, and the point's bit. */
static const struct kiln_tile_run *find_run(const struct kiln_surface *s, uint64_t point, uint32_t *bit)
{
    const struct kiln_tile_run *run = s->tile_runs;
    while (point >= run->first.at + run->count)
        run++;
    uint64_t mask = run->mask;
    for (uint64_t skip = point - run->first.at; skip > 0; skip--)
        mask &= mask - 1;
    *bit = (uint32_t)__builtin_ctzll(mask);
    return run;
}

/* Returns the mask of the points of the run's tile that send light, whose patches have an area. */
static uint64_t sharing(const struct work *w, const struct kiln_tile_run *run)
{
    const struct kiln_surface *s = w->prepared->surface;
    const struct kiln_tile *tile = &s->tiles[s->lightmaps[run->map].tile_first + run->tile];
    uint64_t shares = 0, place = run->first.at;
    for (uint64_t rest = tile->mask | run->mask; rest != 0; rest &= rest - 1) {
        const uint32_t bit = (uint32_t)__builtin_ctzll(rest);
        const uint64_t point = (run->mask >> bit & 1) != 0 ? place++ : kiln_tile_point(s, tile, bit).at;
        if (w->parameters->points[point].area > 0.0f)
            shares |= 1ull << bit;
    }
    return shares;
}

/* Adds the light of the point's link to `to`; `through`: the fraction of it that arrives. */
static void add_link(const struct work *w, const struct kiln_patch *own, double scale, uint32_t to, double through,
                     struct kiln_texel_links *links)
{
    const struct kiln_links_parameters *p = w->parameters;
    const struct kiln_patch_receiver receiver = {dvec3_of(own->normal), dvec3_of(own->normal), false};
    const bool leaf = (to & KILN_LINK_LEAF) != 0;
    const uint32_t first = leaf ? to & ~KILN_LINK_LEAF : p->nodes[to].first, count = leaf ? 1 : p->nodes[to].count;
    struct kiln_link_node_view view;
    const double share =
        100.0 * scale * through * kiln_link_factors(p, &receiver, dvec3_of(own->place), own->number, to, &view).factor;
    for (uint32_t k = first; k < first + count; k++)
        links->share[p->order[k]] = (float)share;
    links->nodes += leaf ? 0 : 1;
    links->single += leaf ? 1 : 0;
    links->all += share;
}

static int take_links(struct work *w, const char *texel, struct kiln_texel_links *links, struct kiln_error *error)
{
    const struct kiln_links_parameters *p = w->parameters;
    const struct kiln_surface *s = w->prepared->surface;
    struct kiln_found_links *f = &w->found;
    uint64_t point;
    uint32_t bit;
    int status = find_point(w->prepared, texel, &point, error);
    if (status != KILN_OK)
        return status;
    const struct kiln_tile_run *run = find_run(s, point, &bit);
    const struct kiln_kept_links *kept = p->kept[run - s->tile_runs];
    if (kept == NULL)
        return kiln_fail(error, KILN_USAGE, "--texel %.100s: no link of that texel is kept", texel);
    status = kiln_links_decode(f, kept, run->mask, sharing(w, run), p->node_count, p->count, error);
    if (status != KILN_OK)
        return status;
    if (f->point[bit].count == 0)
        return kiln_fail(error, KILN_USAGE, "--texel %.100s: that texel is within other geometry, and has no light",
                         texel);
    for (uint64_t i = 0; i < links->points; i++)
        links->share[i] = NAN;
    const double scale = (double)f->point[bit].scale;
    for (uint32_t i = 0; i < f->count; i++)
        if ((f->seen[i] >> bit & 1) != 0)
            add_link(w, &p->points[point], scale, f->to[i], 1.0, links);
    for (uint32_t i = 0; i < f->tinted_count; i++) {
        const float *t = f->tinted[i].through;
        if (f->tinted[i].bit == bit)
            add_link(w, &p->points[point], scale, f->tinted[i].to, ((double)t[0] + (double)t[1] + (double)t[2]) / 3.0,
                     links);
    }
    links->share[point] = -1.0f;
    return KILN_OK;
}

static void release(struct work *w)
{
    kiln_found_links_release(&w->found);
    kiln_patches_destroy(&w->patches);
    kiln_free(&w->radiosity);
    kiln_folder_close(&w->folder);
    kiln_prepared_destroy(&w->prepared);
    kiln_temporary_remove(&w->temporary);
    json_decref(w->index);
    kiln_job_destroy(&w->job);
}

int kiln_texel_links_find(struct kiln_texel_links *links, const char *directory, const char *texel,
                          struct kiln_error *error)
{
    struct work w = {.temporary = {.descriptor = -1}, .folder = {.descriptor = -1}};
    *links = (struct kiln_texel_links){.share = NULL};
    int status;
    KILN_TRY(take_job(&w, directory, error));
    KILN_TRY(prepare(&w, directory, error));
    KILN_TRY(read_links(&w, error));
    links->points = w.prepared->surface->point_count;
    KILN_TRY(kiln_allocate(&links->share, (size_t)links->points, sizeof *links->share, "the links of a texel", error));
    KILN_TRY(take_links(&w, texel, links, error));
end:
    release(&w);
    return status;
}

void kiln_texel_links_release(struct kiln_texel_links *links) { kiln_free(&links->share); }
