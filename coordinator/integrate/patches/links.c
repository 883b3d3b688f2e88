#include "coordinator/integrate/patches/links.h"

#include <math.h>

#include "worker/base/memory.h"

struct kiln_links {
    struct kiln_links_source source;
    struct kiln_link_tree *tree;
    struct kiln_kept_links **kept;
    size_t count; /* tile runs that `kept` has room for */
    struct kiln_links_parameters parameters;
};

int kiln_links_create(struct kiln_links **links, const struct kiln_links_source *source, struct kiln_error *error)
{
    struct kiln_links *l = NULL;
    int status = kiln_allocate(&l, 1, sizeof *l, "the links", error);
    *links = l;
    if (status != KILN_OK)
        return status;
    l->source = *source;
    l->parameters.error = source->choice.error;
    l->parameters.target = source->target;
    l->parameters.stream = source->stream;
    status = kiln_link_tree_create(&l->tree, source->points, source->rooms, source->light, source->surface->point_count,
                                   error);
    if (status != KILN_OK)
        kiln_links_destroy(links);
    return status;
}

static void release_kept(struct kiln_kept_links ***kept, size_t count)
{
    for (size_t i = 0; *kept != NULL && i < count; i++)
        kiln_free(&(*kept)[i]);
    kiln_free(kept);
}

void kiln_links_destroy(struct kiln_links **links)
{
    if (*links == NULL)
        return;
    release_kept(&(*links)->kept, (*links)->count);
    kiln_link_tree_destroy(&(*links)->tree);
    kiln_free(links);
}

/* Whether the kept links belong to the surface's present tile runs. */
static bool is_kept_of_these(const struct kiln_links *l)
{
    const struct kiln_surface *s = l->source.surface;
    if (l->kept == NULL || l->count != s->tile_run_count)
        return false;
    for (size_t i = 0; i < l->count; i++)
        if (l->kept[i] != NULL && l->kept[i]->first != s->tile_runs[i].first.at)
            return false;
    return true;
}

/* Takes over the links of tile runs that the surface still has, and those that another bake has kept. Both lists are in
 * the order of all points. */
static int keep_these(struct kiln_links *l, struct kiln_error *error)
{
    const struct kiln_surface *s = l->source.surface;
    struct kiln_kept_links **kept = NULL;
    const int status = kiln_allocate(&kept, s->tile_run_count, sizeof(struct kiln_kept_links *), "the links", error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0, k = 0; i < l->count; i++) {
        if (l->kept[i] == NULL)
            continue;
        while (k < s->tile_run_count && s->tile_runs[k].first.at < l->kept[i]->first)
            k++;
        if (k < s->tile_run_count && s->tile_runs[k].first.at == l->kept[i]->first) {
            kept[k] = l->kept[i];
            l->kept[i] = NULL;
        }
    }
    release_kept(&l->kept, l->count);
    l->kept = kept;
    l->count = s->tile_run_count;
    uint64_t read;
    return l->source.replayed == NULL
               ? KILN_OK
               : kiln_link_file_read(l->source.replayed, s, kept, &l->source.choice, &read, error);
}

int kiln_links_update(struct kiln_links *l, uint32_t bounce, kiln_link_of_point light, const void *context,
                      const struct kiln_links_parameters **parameters, struct kiln_error *error)
{
    const int status = is_kept_of_these(l) ? KILN_OK : keep_these(l, error);
    if (status != KILN_OK)
        return status;
    kiln_link_tree_set_light(l->tree, bounce, light, context);
    kiln_link_tree_describe(l->tree, &l->parameters);
    l->parameters.kept = l->kept;
    *parameters = &l->parameters;
    return KILN_OK;
}

double kiln_links_point_bytes(uint64_t points, double link_error)
{
    /* the number of links is bounded by their variances, and a point sees about a quarter of those of its tile; seven
     * bytes per link, and the data of points, were measured in rooms */
    const double links = fmin((double)points, 3.0 * KILN_LINKS_UNSEEN / (link_error * link_error));
    return 24.0 + 4.0 * links * 7.0 / KILN_TILE_TEXELS;
}

uint64_t kiln_links_bytes_expected(uint64_t points, uint64_t own, double link_error)
{
    return kiln_link_tree_bytes(points) + (uint64_t)((double)own * kiln_links_point_bytes(points, link_error));
}

void kiln_links_count(const struct kiln_links *l, uint64_t *count, uint64_t *bytes, uint64_t *replayed)
{
    *count = *bytes = *replayed = 0;
    for (size_t i = 0; i < l->count; i++) {
        const struct kiln_kept_links *kept = l->kept[i];
        if (kept == NULL)
            continue;
        *bytes += kiln_links_bytes(kept);
        *count += kept->links;
        *replayed += kept->of_file != 0 ? kept->links : 0;
    }
}

int kiln_links_keep(const struct kiln_links *l, const struct kiln_transport *transport, MPI_Comm communicator,
                    struct kiln_error *error)
{
    return kiln_link_file_write(transport, communicator, l->source.surface, l->kept, &l->source.choice, error);
}
