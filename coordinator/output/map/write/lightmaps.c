#include "coordinator/output/map/write/lightmaps.h"

#include <stdio.h>

#include "coordinator/field/group_fields.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/output/map/bands/bands.h"
#include "coordinator/output/map/charts/chart_graphs.h"
#include "coordinator/output/map/denoise/regression_device.h"
#include "coordinator/output/map/seams/joined.h"
#include "coordinator/output/map/write/stages.h"
#include "coordinator/output/map/write/writer.h"
#include "coordinator/output/provenance.h"
#include "worker/backend/backend.h"
#include "worker/base/memory.h"

static uint64_t texels_at_once(const struct kiln_writer *w)
{
    const struct kiln_surface *s = w->result->surface;
    double texels = 0.0;
    for (uint32_t i = 0; i < s->map_count; i++)
        texels += s->lightmaps[i].published != 0 ? (double)kiln_writer_texels(w, &i, 1) : 0.0;
    return w->params->texel_budget > 0 ? w->params->texel_budget
                                       : kiln_lightmap_texels(w->layers.planes.count, texels / w->ranks);
}

/* Whether, on every rank, the maps of objects that touch may stay in memory until they are written. They may if all fit
 * into one round, or take no more memory than the largest map while it is denoised. Otherwise they are made twice. */
static int may_keep(const struct kiln_writer *w, const struct kiln_assignment *assignment,
                    const struct kiln_joints *joints, bool *keeps, struct kiln_error *error)
{
    uint64_t *texels = NULL, largest = 0, bands = 0, most = 0;
    const int status = kiln_allocate(&texels, w->ranks, sizeof *texels, "the texels of ranks", error);
    for (uint32_t i = 0; status == KILN_OK && i < joints->map_count; i++) {
        const uint64_t of_map = kiln_writer_texels(w, &i, 1);
        largest = of_map > largest ? of_map : largest;
        if (joints->group[i] == KILN_NONE || assignment->owner[i] == KILN_NONE)
            continue;
        if (assignment->owner[i] == KILN_IN_BANDS)
            bands += of_map / w->ranks;
        else
            texels[assignment->owner[i]] += of_map;
    }
    for (uint32_t i = 0; status == KILN_OK && i < w->ranks; i++)
        most = texels[i] + bands > most ? texels[i] + bands : most;
    kiln_free(&texels);
    const bool one_round = assignment->own_rounds <= 1 && assignment->rounds - assignment->own_rounds <= 1;
    *keeps = one_round || most <= texels_at_once(w) || most <= 2 * largest;
    return kiln_agree(w->result->communicator, status, error);
}

/* Collective. Writes all files, with the solved seams of objects that touch. For maps that were kept no points are sent
 * again. */
static int write_rounds(struct kiln_writer *w, const struct kiln_assignment *assignment,
                        const struct kiln_joints *joints, struct kiln_error *error)
{
    struct kiln_assignment others = {0};
    if (joints->count == 0 || !w->params->stitch)
        return kiln_writer_walk_rounds(w, assignment, assignment, w->ghosts, kiln_writer_write, error);
    int status;
    KILN_TRY(may_keep(w, assignment, joints, &w->keeps, error));
    KILN_TRY(kiln_writer_join(w, assignment, joints, error));
    KILN_TRY(kiln_agree(w->result->communicator, kiln_writer_choose(&others, assignment, joints, false, error), error));
    KILN_TRY(kiln_writer_walk_rounds(w, assignment, w->keeps ? &others : assignment, w->keeps ? NULL : w->ghosts,
                                     kiln_writer_write, error));
end:
    kiln_free(&others.owner);
    return status;
}

/* Removes lightmaps that need not be written. Of lightmaps that touch one another all are kept, or none. Returns
 * whether lightmaps that touch are left. */
static bool leave_out(const struct kiln_writer *w, struct kiln_assignment *assignment, const struct kiln_joints *joints)
{
    const uint8_t *only = w->params->only;
    bool touching = only == NULL;
    for (size_t i = 0; only != NULL && joints != NULL && i < joints->map_count; i++)
        touching = touching || (only[i] != 0 && joints->group[i] != KILN_NONE);
    for (size_t i = 0; only != NULL && i < assignment->count; i++)
        if (only[i] == 0 && !(touching && joints != NULL && joints->group[i] != KILN_NONE))
            assignment->owner[i] = assignment->round[i] = KILN_NONE;
    return touching;
}

/* Collective. Finds where objects touch, if seams are to be smoothed or noise to be removed, and writes all files. */
static int write_all(struct kiln_writer *w, struct kiln_error *error)
{
    static const struct kiln_joints none = {0};
    struct kiln_assignment *assignment = NULL;
    struct kiln_joints *joints = NULL;
    int status = KILN_OK;
    if (w->params->stitch || w->params->denoise)
        status =
            kiln_joints_find(&joints, w->result->scene, w->result->surface, (double)w->result->geometry->extent, error);
    if (status == KILN_OK)
        status = kiln_assignment_create(
            &assignment, w->result->surface->lightmaps, w->result->surface->map_count, w->ranks, texels_at_once(w),
            w->params->least_divided > 0 ? w->params->least_divided : KILN_BANDS_LEAST, error);
    const bool touching = status == KILN_OK && leave_out(w, assignment, joints);
    if (status == KILN_OK && joints != NULL && touching && w->params->denoise)
        status = kiln_ghosts_create(&w->ghosts, joints, w->result->surface, error);
    status = kiln_agree(w->result->communicator, status, error);
    if (status == KILN_OK)
        status = write_rounds(w, assignment, joints != NULL && touching ? joints : &none, error);
    kiln_joined_destroy(&w->joined);
    kiln_ghosts_destroy(&w->ghosts);
    kiln_joints_destroy(&joints);
    kiln_assignment_destroy(&assignment);
    return status;
}

/* Collective. Combines the reports by a bitwise or, which is exact, since each is filled in on one rank and zero on
 * others. */
static int gather_reports(const struct kiln_bake_result *result, const struct kiln_lightmap_report *own, int rank,
                          struct kiln_lightmap_report *reports, struct kiln_error *error)
{
    enum { AT_ONCE = 1 << 16 };
    for (size_t first = 0; first < result->surface->map_count; first += AT_ONCE) {
        const size_t left = result->surface->map_count - first;
        const int count = (int)(left < AT_ONCE ? left : AT_ONCE);
        /* the struct contains numbers of different sizes, so it is combined as bytes */
        if (MPI_Reduce(own + first, rank == 0 ? reports + first : NULL, count * (int)sizeof *own, MPI_BYTE, MPI_BOR, 0,
                       result->communicator) != MPI_SUCCESS)
            return kiln_fail(error, KILN_RANK_LOST, "MPI failed while the ranks' reports on lightmaps were gathered");
    }
    for (size_t i = 0; rank != 0 && i < result->surface->map_count; i++)
        reports[i] = (struct kiln_lightmap_report){.map = (uint32_t)i};
    return KILN_OK;
}

static int make_folder(const char *directory, const char *name, bool backs, struct kiln_error *error)
{
    struct kiln_folder made;
    char path[KILN_GROUP_FOLDER + 8];
    (void)snprintf(path, sizeof path, "%s%s", name, backs ? "/back" : "");
    const int status = kiln_folder_open(&made, directory, path, true, error);
    kiln_folder_close(&made);
    return status;
}

/* Makes the folders of the parts of the scene, FOLDER/PART and FOLDER/back/PART. */
static int make_part_folders(const struct kiln_writer *w, const char *folder, struct kiln_error *error)
{
    const struct kiln_surface *surface = w->result->surface;
    const struct kiln_scene *scene = w->result->scene;
    char made[KILN_PATH_SIZE] = "", path[KILN_PATH_SIZE];
    int status = KILN_OK;
    for (uint32_t i = 0; status == KILN_OK && i < surface->map_count; i++) {
        const char *name = kiln_scene_string(scene, scene->objects[kiln_map_object(surface, i)].name),
                   *slash = strchr(name, '/');
        if (slash == NULL || surface->lightmaps[i].published == 0)
            continue;
        (void)snprintf(path, sizeof path, "%s/%s%.*s/", folder, kiln_map_back(surface, i) ? "back/" : "",
                       (int)(slash - name), name);
        if (strcmp(path, made) != 0) /* objects of a part stand together */
            status = kiln_make_parents(w->params->directory, path, error);
        memcpy(made, path, sizeof made);
    }
    return status;
}

static int make_folders(const struct kiln_writer *w, const struct kiln_surface *surface, const char *directory,
                        struct kiln_error *error)
{
    bool backs = false;
    for (uint32_t i = surface->object_count; i < surface->map_count; i++)
        backs = backs || surface->lightmaps[i].published != 0;
    int status;
    KILN_TRY(make_folder(directory, "lightmaps", backs, error));
    KILN_TRY(make_part_folders(w, "lightmaps", error));
    for (size_t n = 0; n < kiln_writer_group_files(w); n++) {
        char folder[KILN_GROUP_FOLDER];
        kiln_group_folder(n, folder);
        KILN_TRY(make_folder(directory, folder, backs, error));
        KILN_TRY(make_part_folders(w, folder, error));
    }
end:
    return status;
}

/* Software devices are slower than the host. */
static int find_device(struct kiln_writer *w, struct kiln_error *error)
{
    struct kiln_backend_info info = {.regresses = false};
    if (w->params->backend != NULL)
        kiln_backend_info(w->params->backend, &info);
    return info.regresses ? kiln_regression_device_create(&w->device, w->params->backend, error) : KILN_OK;
}

int kiln_write_lightmaps(const struct kiln_bake_result *result, const struct kiln_output_params *params,
                         struct kiln_lightmap_report *reports, double *denoising, struct kiln_error *error)
{
    const size_t maps = result->surface->map_count;
    double seconds = 0.0;
    struct kiln_writer w = {.result = result, .params = params, .denoising = &seconds};
    int rank = 0, ranks = 1;
    if (MPI_Comm_rank(result->communicator, &rank) != MPI_SUCCESS ||
        MPI_Comm_size(result->communicator, &ranks) != MPI_SUCCESS)
        return kiln_fail(error, KILN_RANK_LOST, "MPI cannot give the rank number");
    w.rank = (uint32_t)rank;
    w.ranks = (uint32_t)ranks;
    w.has_caustics = kiln_field_set_find(result->fields, "caustic") < result->fields->count;
    w.has_seed = kiln_provenance_seed(params->provenance_json, &w.seed);
    int status = rank == 0 ? make_folders(&w, result->surface, params->directory, error) : KILN_OK;
    if (status == KILN_OK)
        status = kiln_layers_make(&w.layers, result->fields, error);
    if (status == KILN_OK)
        status = kiln_map_stages_layers(kiln_map_stages, params, &w.layers, result->fields, error);
    if (status == KILN_OK)
        status = kiln_allocate(&w.reports, maps, sizeof *w.reports, "reports on lightmaps", error);
    if (status == KILN_OK)
        status = kiln_allocate(&w.works, maps, sizeof *w.works, "lightmaps", error);
    if (status == KILN_OK)
        status = kiln_chart_graphs_create(&w.graphs, result->scene, error);
    for (size_t i = 0; status == KILN_OK && i < maps; i++)
        kiln_chart_graphs_expect(w.graphs, result->scene->objects[kiln_map_object(result->surface, (uint32_t)i)].mesh);
    if (status == KILN_OK)
        status = find_device(&w, error);
    status = kiln_agree(result->communicator, status, error);
    if (status == KILN_OK)
        status = kiln_bands_create(&w.bands, result->communicator, error);
    if (status == KILN_OK)
        status = write_all(&w, error);
    if (status == KILN_OK && reports != NULL)
        status = kiln_agree(result->communicator, gather_reports(result, w.reports, rank, reports, error), error);
    for (size_t i = 0; w.works != NULL && i < maps; i++)
        kiln_writer_drop(&w, (uint32_t)i);
    kiln_chart_graphs_destroy(&w.graphs);
    kiln_regression_device_destroy(&w.device);
    kiln_bands_destroy(&w.bands);
    kiln_free(&w.works);
    kiln_free(&w.reports);
    if (denoising != NULL)
        *denoising = seconds;
    return status;
}
