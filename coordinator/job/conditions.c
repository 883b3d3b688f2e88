#include "coordinator/job/conditions.h"

#include <math.h>
#include <string.h>

#include "coordinator/job/options.h"

static bool is(const char *text, const char *wanted)
{
    return text != NULL && wanted != NULL && strcmp(text, wanted) == 0;
}

static bool has_command(const struct kiln_job *j, const char *name) { return is(j->command, name); }

/* ---- where it runs, light ---- */

static bool of_device(const struct kiln_job *j) { return !is(j->machine.backend, "embree"); }
const struct kiln_condition kiln_when_device = {of_device, "--backend embree has no device; give --backend vulkan",
                                                "--backend vulkan", "--backend embree", "bake"};

static bool of_sky(const struct kiln_job *j) { return !is(j->scene.environment, "none"); }
const struct kiln_condition kiln_when_sky = {of_sky, "--environment none is no light; give another --environment",
                                             "--environment 1,1,1", "--environment none", "bake"};

/* Whether the environment is an image. A constant radiance has only the characters of numbers and commas, which no path
 * consists of. */
static bool of_image(const struct kiln_job *j)
{
    return of_sky(j) && (j->scene.environment == NULL ||
                         strspn(j->scene.environment, "0123456789.,+-eE") < strlen(j->scene.environment));
}
const struct kiln_condition kiln_when_image = {
    of_image, "an environment that is the same all round cannot be turned; give an image as --environment", "",
    "--environment 1,1,1", "bake"};

/* ---- light between patches ---- */

static bool of_patches(const struct kiln_job *j) { return kiln_job_is_radiosity(j); }
const struct kiln_condition kiln_when_patches = {of_patches, "light goes between no patches; give --method radiosity",
                                                 "--method radiosity", "", "bake"};

static bool of_links(const struct kiln_job *j) { return kiln_job_has_links(j); }
const struct kiln_condition kiln_when_links = {of_links, "there are no links; give --method radiosity --patches links",
                                               "--method radiosity --patches links", "", "bake"};

static bool of_unshot(const struct kiln_job *j) { return of_patches(j) && j->light.patches.order == KILN_ORDER_UNSHOT; }
const struct kiln_condition kiln_when_unshot = {of_unshot,
                                                "all patches send at once; give --method radiosity --order unshot",
                                                "--method radiosity --order unshot", "", "bake"};

static bool of_directions(const struct kiln_job *j)
{
    return of_patches(j) && j->light.patches.gather != KILN_GATHER_PAIRS;
}
const struct kiln_condition kiln_when_directions = {
    of_directions, "pairs of patches have no directions; give --method radiosity --gather cosine",
    "--method radiosity --gather cosine", "", "bake"};

static bool of_window(const struct kiln_job *j)
{
    return of_patches(j) && j->light.patches.undersample != KILN_SAMPLE_ALL;
}
const struct kiln_condition kiln_when_undersampled = {of_window,
                                                      "all texels send; give --method radiosity --undersample mipmap",
                                                      "--method radiosity --undersample mipmap", "", "bake"};

static bool of_division(const struct kiln_job *j) { return of_patches(j) && j->light.patches.subdivide > 0.0; }
const struct kiln_condition kiln_when_divided = {of_division,
                                                 "each texel is a node; give --method radiosity --subdivide 0.1",
                                                 "--method radiosity --subdivide 0.1", "", "bake"};

static bool of_nodes(const struct kiln_job *j) { return of_window(j) || of_division(j); }
const struct kiln_condition kiln_when_nodes = {
    of_nodes, "each texel is a node; give --method radiosity --undersample mipmap, or --subdivide 0.1",
    "--method radiosity --subdivide 0.1", "", "bake"};

static bool of_voxels(const struct kiln_job *j)
{
    return of_patches(j) && j->light.patches.visibility == KILN_VISIBILITY_VOXELS;
}
const struct kiln_condition kiln_when_voxels = {
    of_voxels, "rays say what patches see; give --method radiosity --visibility voxels",
    "--method radiosity --visibility voxels", "", "bake"};

/* ---- bounces ---- */

static bool is_cells(const struct kiln_job *j) { return !kiln_job_is_reference(j) && !kiln_job_is_radiosity(j); }
const struct kiln_condition kiln_when_cells = {is_cells, "only --method cells gathers so; give that", "",
                                               "--method path", "bake"};

static bool has_bounces(const struct kiln_job *j) { return j->light.bounces != 0; }
const struct kiln_condition kiln_when_bounces = {has_bounces, "--bounces 0 is direct light alone; give more bounces",
                                                 "", "--bounces 0", "bake"};

static bool is_lean(const struct kiln_job *j)
{
    return is_cells(j) && has_bounces(j) && j->light.schedule == KILN_SCHEDULE_LEAN;
}
const struct kiln_condition kiln_when_lean = {
    is_lean, "it is for bounces of few rays before a final gather; give --method cells, --schedule lean and bounces",
    "", "--schedule equal", "bake"};

/* ---- gloss ---- */

static bool has_gloss(const struct kiln_job *j) { return j->light.materials != KILN_GLOSS_MODE_DIFFUSE; }
const struct kiln_condition kiln_when_gloss = {
    has_gloss, "--materials diffuse has no mirrors, gloss or glass; give --materials auto or full", "",
    "--materials diffuse", "bake"};
static bool has_caustics(const struct kiln_job *j) { return has_gloss(j) && is_cells(j); }
const struct kiln_condition kiln_when_caustics = {
    has_caustics, "--materials diffuse has no light by mirrors, gloss or glass; give --materials auto or full", "",
    "--materials diffuse", "bake"};

/* Returns the --caustics in effect: none without gloss. */
static int caustics_of(const struct kiln_job *j)
{
    if (!has_caustics(j))
        return KILN_CAUSTICS_NONE;
    return j->light.caustics == KILN_CAUSTICS_AUTO ? KILN_CAUSTICS_VCM : j->light.caustics;
}

static bool has_paths(const struct kiln_job *j) { return caustics_of(j) >= KILN_CAUSTICS_LAND; }
const struct kiln_condition kiln_when_paths_land = {
    has_paths, "no light paths are sent; give --materials auto or full, and --caustics land, merge or vcm", "",
    "--materials diffuse", "bake"};

static bool merges(const struct kiln_job *j) { return caustics_of(j) >= KILN_CAUSTICS_MERGE; }
const struct kiln_condition kiln_when_merged = {
    merges, "nothing is merged; give --materials auto or full, and --caustics merge or vcm", "", "--materials diffuse",
    "bake"};

static bool shares(const struct kiln_job *j) { return caustics_of(j) == KILN_CAUSTICS_VCM; }
const struct kiln_condition kiln_when_shared = {
    shares, "gather rays and light paths share nothing; give --materials auto or full, and --caustics vcm", "",
    "--materials diffuse", "bake"};

static bool has_radius(const struct kiln_job *j) { return merges(j) || is(j->light.method, "vcm"); }
const struct kiln_condition kiln_when_radius = {
    has_radius, "nothing is merged; give --materials auto or full and --caustics merge or vcm, or --method vcm", "",
    "--materials diffuse", "bake"};

/* ---- texels, volume, range ---- */

static bool is_lightmap(const struct kiln_job *j) { return j->lightmaps.store == KILN_STORE_KIND_LIGHTMAP; }
const struct kiln_condition kiln_when_lightmaps = {is_lightmap, "there are no lightmaps; give --store lightmap", "",
                                                   "--store octree", "bake"};

static bool has_leaves(const struct kiln_job *j) { return !is_lightmap(j); }
const struct kiln_condition kiln_when_leaves = {has_leaves, "lightmaps have no leaves; give --store octree",
                                                "--store octree", "", "bake"};

static bool by_density(const struct kiln_job *j)
{
    return is_lightmap(j) ? j->lightmaps.size == 0 : j->lightmaps.leaf_size == 0.0;
}
const struct kiln_condition kiln_when_density = {
    by_density, "--lightmap-size or --leaf-size says how fine texels are; leave that out", "", "--lightmap-size 16",
    "bake"};

static bool has_volume(const struct kiln_job *j) { return j->volume.samples > 0; }
const struct kiln_condition kiln_when_volume = {has_volume, "--samples-probe 0 has no volume; give more", "",
                                                "--samples-probe 0", "bake"};

static bool has_range(const struct kiln_job *j) { return is_cells(j) && j->light.radiance.range < (double)INFINITY; }
const struct kiln_condition kiln_when_range = {
    has_range, "gather rays end at no range, and there are no radiance probes; give --tracing-range M",
    "--tracing-range 1", "", "bake"};

static bool has_map_basis(const struct kiln_job *j) { return has_range(j) && j->light.radiance.basis != 0; }
const struct kiln_condition kiln_when_map_basis = {
    has_map_basis, "no radiance probe keeps a map; give --tracing-range M and --probe-basis octahedral or cubemap",
    "--tracing-range 1 --probe-basis cubemap", "", "bake"};

/* ---- pictures ---- */

static bool has_picture(const struct kiln_job *j) { return j->preview || !has_command(j, "bake"); }
const struct kiln_condition kiln_when_picture = {has_picture, "--no-preview draws no picture; leave that out", "",
                                                 "--no-preview", "bake"};

static bool is_rgbm(const struct kiln_job *j) { return j->exported.format == KILN_PAGE_RGBM; }
const struct kiln_condition kiln_when_rgbm = {is_rgbm, "only RGBM pages have a range; give --format rgbm",
                                              "--format rgbm", "", "export"};

static bool is_traced(const struct kiln_job *j)
{
    return !has_command(j, "view") || kiln_view_is_traced(j->view.method);
}
const struct kiln_condition kiln_when_traced = {
    is_traced, "lightmaps are shown as they were baked, and no path is traced; give --method path or its like",
    "--method path", "", "view"};

static bool is_merging(const struct kiln_job *j) { return j->view.method >= KILN_VIEW_METHOD_vcm; }
const struct kiln_condition kiln_when_merging_view = {is_merging, "nothing is merged; give --method vcm or its like",
                                                      "--method vcm", "", "view"};

static bool is_kept(const struct kiln_job *j) { return !has_command(j, "view") || j->view.accumulate != NULL; }
const struct kiln_condition kiln_when_accumulated = {is_kept, "nothing is kept of a view; give --accumulate DIR",
                                                     "--method path --accumulate sums", "", "view"};

static bool has_frames(const struct kiln_job *j) { return j->view.path != NULL; }
const struct kiln_condition kiln_when_frames = {has_frames, "there are no frames; give --path FILE.csv",
                                                "--path path.csv", "", "view"};

static bool has_lens(const struct kiln_job *j) { return is_traced(j) && j->view.lens_radius > 0.0; }
const struct kiln_condition kiln_when_lens = {has_lens, "a pinhole is sharp everywhere; give --lens-radius",
                                              "--method path --lens-radius 0.1", "", "view"};

static bool shows_lightmaps(const struct kiln_job *j) { return !kiln_view_is_traced(j->view.method); }
const struct kiln_condition kiln_when_shown_lightmaps = {
    shows_lightmaps, "paths are traced, and no lightmap is shown; give --method lightmaps", "", "--method path",
    "view"};

/* ---- benches ---- */

static bool has_rank_counts(const struct kiln_job *j)
{
    return j->argument_count > 0 && is(j->arguments[0], "scaling");
}
const struct kiln_condition kiln_when_ranks_bench = {has_rank_counts, "this bench counts no ranks; scaling does",
                                                     "scaling", "rays", "bench"};

static bool has_repeats(const struct kiln_job *j) { return j->argument_count > 0 && is(j->arguments[0], "rays"); }
const struct kiln_condition kiln_when_repeats = {has_repeats, "this bench repeats nothing; rays does", "rays",
                                                 "scaling", "bench"};
