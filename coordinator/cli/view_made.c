#include "coordinator/cli/view_made.h"

#include <stdio.h>
#include <string.h>

#include <jansson.h>

#include "coordinator/bake/texel_links.h"
#include "coordinator/output/read/results.h"
#include "coordinator/view/view_light.h"
#include "worker/base/text.h"

int kiln_view_made_check(const struct kiln_job *job, const struct kiln_show *show, bool voxels_given, bool filter_given,
                         struct kiln_error *error)
{
    const bool voxels = show->kind == KILN_SHOW_VOXELS || show->kind == KILN_SHOW_VOXEL;
    if (voxels_given && !voxels && show->kind != KILN_SHOW_SEEN)
        return kiln_fail(error, KILN_USAGE, "--voxels: no grid is shown; give --show voxels, or leave --voxels out");
    if (job->view.texel != NULL && show->kind != KILN_SHOW_LINKS && show->kind != KILN_SHOW_SEEN)
        return kiln_fail(error, KILN_USAGE,
                         "--texel %.100s: nothing is shown of a texel; give --show links or seen, or leave --texel out",
                         job->view.texel);
    if (show->kind == KILN_SHOW_VOXELS && filter_given && job->view.atlas == NULL)
        return kiln_fail(error, KILN_USAGE,
                         "--filter: cells are shown as they are; leave --filter out, or give --show voxel, which goes "
                         "by surfaces");
    if (show->kind == KILN_SHOW_LINKS && job->view.texel == NULL)
        return kiln_fail(error, KILN_USAGE, "--show links: of which texel? Give --texel OBJECT,X,Y, such as floor,3,4");
    return KILN_OK;
}

/* ---- voxels ---- */

/* Finds the number of cells along the longest side: --voxels, or that of the bake. */
static int find_along(uint32_t *along, const struct kiln_job *job, struct kiln_results *results,
                      struct kiln_error *error)
{
    json_t *run = NULL;
    *along = job->view.voxels;
    if (*along > 0)
        return KILN_OK;
    const int status = kiln_results_json(results, "run.json", &run, error);
    const json_t *baked = json_object_get(json_object_get(run, "job"), "voxels");
    *along = json_is_integer(baked) ? (uint32_t)json_integer_value(baked) : 0;
    json_decref(run);
    if (status == KILN_OK && (*along < 1 || *along > KILN_VOXELS_MOST))
        return kiln_fail(error, KILN_NO_INPUT,
                         "--show %s: the bake in %.500s had no grid of voxels; give --voxels N to see one of N cells "
                         "along the scene's longest side, or bake with --method radiosity --visibility voxels",
                         job->view.show, job->arguments[0]);
    return status;
}

static int make_voxels(struct kiln_view_made *m, const struct kiln_job *job, const struct kiln_show *show,
                       struct kiln_results *results, const struct kiln_geometry *geometry, struct kiln_error *error)
{
    uint32_t along;
    int status = find_along(&along, job, results, error);
    if (status == KILN_OK)
        status = kiln_voxels_create(&m->voxels, geometry, along, error);
    if (status != KILN_OK)
        return status;
    m->boxes = show->kind == KILN_SHOW_VOXELS && job->view.atlas == NULL;
    m->renderer = (struct kiln_view_renderer){kiln_voxel_view_render, m->voxels};
    kiln_voxel_view_key(m->voxels, m->boxes, &m->key);
    return KILN_OK;
}

/* ---- links ---- */

static int make_links(struct kiln_view_made *m, const struct kiln_job *job, const struct kiln_show *show,
                      struct kiln_results *results, const struct kiln_scene *scene, struct kiln_error *error)
{
    struct kiln_texel_links links;
    char texel[80];
    int status;
    KILN_TRY(kiln_texel_links_find(&links, job->arguments[0], job->view.texel, error));
    KILN_TRY(kiln_point_dataset_read(&m->rows, results, &show->field, (uint32_t)scene->object_count, error));
    KILN_TRY(kiln_point_dataset_replace(m->rows, links.share, 1, links.points, error));
end:
    m->nodes = links.nodes;
    m->single = links.single;
    m->all = links.all;
    (void)snprintf(m->note, sizeof m->note,
                   "the texel %s gathers from %u nodes and %u single texels, %.4g %% of its view; orange: itself",
                   kiln_text_plain(texel, sizeof texel, job->view.texel), m->nodes, m->single, m->all);
    kiln_texel_links_release(&links);
    return status;
}

/* ---- what a texel sees ---- */

static int make_seen(struct kiln_view_made *m, const struct kiln_job *job, const struct kiln_show *show,
                     struct kiln_results *results, const struct kiln_scene *scene, const struct kiln_geometry *geometry,
                     struct kiln_error *error)
{
    struct kiln_seen *s = &m->seen;
    struct kiln_voxels *voxels = NULL;
    char texel[sizeof s->texel], by[80];
    int status;
    KILN_TRY(job->view.voxels > 0 ? kiln_voxels_create(&voxels, geometry, job->view.voxels, error) : KILN_OK);
    KILN_TRY(kiln_seen_find(s, results, scene, geometry, job->view.texel, voxels, error));
    KILN_TRY(kiln_point_dataset_read(&m->rows, results, &show->field, (uint32_t)scene->object_count, error));
    KILN_TRY(kiln_point_dataset_replace(m->rows, s->color, 3, s->points, error));
end:
    kiln_seen_key(&m->key);
    (void)snprintf(by, sizeof by, ", by %u voxels %llu, of which %llu are the same ones", job->view.voxels,
                   (unsigned long long)s->by_voxels, (unsigned long long)s->by_both);
    (void)snprintf(m->note, sizeof m->note, "the texel %s faces %llu texels, and sees %llu of them by rays%s",
                   kiln_text_plain(texel, sizeof texel, s->texel), (unsigned long long)s->facing,
                   (unsigned long long)s->by_rays, voxels != NULL ? by : "");
    kiln_voxels_destroy(&voxels);
    kiln_seen_release(s);
    return status;
}

/* ---- all ---- */

int kiln_view_made_create(struct kiln_view_made *m, const struct kiln_job *job, const struct kiln_show *show,
                          struct kiln_results *results, const struct kiln_scene *scene,
                          const struct kiln_geometry *geometry, struct kiln_error *error)
{
    if (show->kind == KILN_SHOW_VOXELS || show->kind == KILN_SHOW_VOXEL)
        return make_voxels(m, job, show, results, geometry, error);
    if (show->kind == KILN_SHOW_SEEN)
        return make_seen(m, job, show, results, scene, geometry, error);
    return show->kind == KILN_SHOW_LINKS ? make_links(m, job, show, results, scene, error) : KILN_OK;
}

void kiln_view_made_give_rows(struct kiln_view_made *m, struct kiln_view_maps *maps)
{
    if (m->rows != NULL)
        kiln_view_maps_take_rows(maps, &m->rows);
}

void kiln_view_made_lend(struct kiln_view_made *m, struct kiln_view_source *source)
{
    source->voxels = m->voxels;
    if (m->boxes)
        source->renderer = &m->renderer;
}

void kiln_view_made_destroy(struct kiln_view_made *m)
{
    kiln_voxels_destroy(&m->voxels);
    kiln_point_dataset_destroy(&m->rows);
}
