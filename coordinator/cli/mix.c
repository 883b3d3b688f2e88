/* kiln mix DIR: adds up the groups of lights that a bake has told apart, each by a factor (mix_factors.h). No ray is
 * traced: the folder that it writes has lightmaps, scene, preview and report, and no surface points. */
#include <errno.h>
#include <mpi.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "coordinator/cli/commands.h"
#include "coordinator/cli/mix_factors.h"
#include "coordinator/cli/mix_maps.h"
#include "coordinator/cli/mix_preview.h"
#include "coordinator/cli/mix_scene.h"
#include "coordinator/cli/mix_volume.h"
#include "coordinator/files/json.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/output/manifest.h"
#include "coordinator/output/read/results.h"
#include "coordinator/run/output_folder.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"
#include "worker/base/text.h"

enum { SCENE_NAME = 300 }; /* bytes of the path of a .glb, relative to the folder */

struct map {
    const char *name;     /* "lightmaps/a.exr" */
    const json_t *object; /* of run.json */
    bool back;
};

struct mix {
    const struct kiln_job *job;
    const char *directory, *output;
    int rank, ranks;
    struct kiln_results *results;
    json_t *run;
    struct kiln_mix_factors factors;
    struct map *maps;
    size_t map_count;
    double *ratios;             /* of each map: kiln_mix_map */
    char (*scenes)[SCENE_NAME]; /* scene.glb, or scenes/PART.glb of each part and place, that the bake has */
    size_t scene_count;
    bool has_volume;                   /* volume.hdf */
    json_t *as_baked;                  /* names: kiln_mix_scene_write */
    struct kiln_output_folder *folder; /* rank 0 */
    double begin;
};

/* ---- before anything is written ---- */

static int list_maps(struct mix *m, struct kiln_error *error)
{
    const json_t *objects = json_object_get(m->run, "objects");
    int status = kiln_allocate(&m->maps, 2 * json_array_size(objects) + 1, sizeof *m->maps, "lightmaps", error);
    for (size_t i = 0; i < json_array_size(objects) && status == KILN_OK; i++)
        for (int back = 0; back < 2; back++) {
            const json_t *object = json_array_get(objects, i);
            const char *name = json_string_value(json_object_get(object, back ? "lightmap_back" : "lightmap"));
            if (name != NULL && strncmp(name, "lightmaps/", strlen("lightmaps/")) == 0)
                m->maps[m->map_count++] = (struct map){name, object, back != 0};
        }
    if (status == KILN_OK && m->map_count == 0)
        status = kiln_fail(error, KILN_BAD_INPUT,
                           "%.300s has no lightmaps to mix: its light is in kiln.h5; bake with --store lightmap",
                           m->directory);
    if (status == KILN_OK)
        status = kiln_allocate(&m->ratios, m->map_count, sizeof *m->ratios, "lightmaps", error);
    return status;
}

/* The number of bytes of PART/ in "lightmaps/PART/OBJECT.exr"; 0: the scene is not in parts. */
static size_t part_of(const char *map)
{
    const char *object = strrchr(map + strlen("lightmaps/"), '/');
    return object == NULL ? 0 : (size_t)(object + 1 - (map + strlen("lightmaps/")));
}

static int list_scenes(struct mix *m, struct kiln_error *error)
{
    const char *before = "";
    int status = kiln_allocate(&m->scenes, m->map_count + 1, sizeof *m->scenes, "scenes", error);
    if (status != KILN_OK)
        return status;
    (void)snprintf(m->scenes[0], SCENE_NAME, "scene.glb");
    m->scene_count = kiln_results_has(m->results, "scene.glb") ? 1 : 0;
    for (size_t i = 0; i < m->map_count; i++) {
        const char *part = m->maps[i].name + strlen("lightmaps/");
        const size_t length = part_of(m->maps[i].name);
        if (m->maps[i].back || length == 0 || length >= SCENE_NAME / 2 || strncmp(part, before, length) == 0)
            continue;
        before = part;
        (void)snprintf(m->scenes[m->scene_count], SCENE_NAME, "scenes/%.*s.glb", (int)length - 1, part);
        m->scene_count += kiln_results_has(m->results, m->scenes[m->scene_count]) ? 1 : 0;
    }
    return KILN_OK;
}

static int open_bake(struct mix *m, struct kiln_error *error)
{
    int status = kiln_results_open(&m->results, m->directory, error);
    if (status == KILN_OK)
        status = kiln_results_json(m->results, "run.json", &m->run, error);
    if (status == KILN_NO_INPUT || (status == KILN_OK && kiln_results_manifest(m->results) == NULL))
        return kiln_fail(error, KILN_NO_INPUT, "%.300s holds no finished bake: bake first", m->directory);
    KILN_TRY(status);
    KILN_TRY(kiln_lock_refuse(m->directory, error));
    KILN_TRY(kiln_mix_factors_make(&m->factors, m->job, m->run, error));
    KILN_TRY(list_maps(m, error));
    KILN_TRY(list_scenes(m, error));
end:
    m->has_volume = status == KILN_OK && kiln_mix_has_volume(m->results, m->run);
    return status;
}

/* Implements kiln_output_folder_params.has_results: whether the folder has a mixture. */
static bool has_mixture(const char *directory, const void *context)
{
    (void)context;
    struct kiln_results *there = NULL;
    json_t *run = NULL;
    const bool is = kiln_results_open(&there, directory, NULL) == KILN_OK &&
                    kiln_results_json(there, "run.json", &run, NULL) == KILN_OK && json_object_get(run, "mix") != NULL;
    json_decref(run);
    kiln_results_close(&there);
    return is;
}

static int check_output(const struct mix *m, struct kiln_error *error)
{
    struct stat a, b;
    if (stat(m->output, &a) == 0 && stat(m->directory, &b) == 0 && a.st_dev == b.st_dev && a.st_ino == b.st_ino)
        return kiln_fail(error, KILN_USAGE, "%.500s is the folder of the bake that is mixed: give another one with -o",
                         m->output);
    return KILN_OK;
}

/* ---- the manifest ---- */

/* Lists the files of the mixture except run.json and scene.kscene. `names` has room for them. Returns their number. */
static size_t name_files(const struct mix *m, char **names)
{
    static char volume[] = "volume.hdf";
    size_t count = 0;
    for (size_t i = 0; i < m->map_count; i++)
        names[count++] = (char *)(uintptr_t)m->maps[i].name;
    for (size_t i = 0; i < m->scene_count; i++)
        names[count++] = m->scenes[i];
    if (m->has_volume)
        names[count++] = volume;
    return count;
}

/* Manages the manifest of the mixture's folder, in two calls. Before the files are written (`after` false), rank 0
 * checks that they can be, and removes outdated files and the old manifest. Afterwards all ranks write the new
 * manifest. Collective. */
static int with_manifest(const struct mix *m, bool after, struct kiln_error *error)
{
    char **names = NULL;
    struct kiln_pruned pruned;
    int status = kiln_allocate(&names, m->map_count + m->scene_count + 1, sizeof *names, "the manifest", error);
    status = kiln_agree(MPI_COMM_WORLD, status, error);
    const struct kiln_optional_results parts = {
        .more = names, .more_count = status == KILN_OK ? name_files(m, names) : 0, .preview = true, .no_points = true};
    if (status == KILN_OK && after)
        status = kiln_manifest_write(MPI_COMM_WORLD, m->output, NULL, NULL, &parts, error);
    if (status == KILN_OK && !after && m->rank == 0) {
        status = kiln_manifest_look(m->output, NULL, NULL, &parts, error);
        if (status == KILN_OK)
            status = kiln_manifest_prune(m->output, NULL, NULL, &parts, &pruned, error);
        if (status == KILN_OK)
            status = kiln_manifest_remove(m->output, error);
    }
    kiln_free(&names);
    return kiln_agree(MPI_COMM_WORLD, status, error);
}

/* ---- files ---- */

/* Rank 0. */
static int make_folders(struct mix *m, struct kiln_error *error)
{
    const struct kiln_output_folder_params params = {.directory = m->output,
                                                     .kind = KILN_FOLDER_OWNED,
                                                     .owner = "kiln mix",
                                                     .has_results = has_mixture,
                                                     .no_locks = m->job->faults.no_locks};
    struct kiln_folder folder;
    bool backs = false;
    int status = kiln_output_folder_begin(&m->folder, &params, error);
    for (size_t i = 0; i < m->map_count; i++)
        backs = backs || m->maps[i].back;
    if (status != KILN_OK)
        return status;
    status = kiln_folder_open(&folder, m->output, backs ? "lightmaps/back" : "lightmaps", true, error);
    kiln_folder_close(&folder);
    for (size_t i = 0; status == KILN_OK && i < m->map_count; i++)
        status = kiln_make_parents(m->output, m->maps[i].name, error);
    for (size_t i = 0; status == KILN_OK && i < m->scene_count; i++)
        status = kiln_make_parents(m->output, m->scenes[i], error);
    return status;
}

/* Collective. Mixes this rank's part of the lightmaps. */
static int mix_maps(const struct mix *m, struct kiln_error *error)
{
    struct kiln_mix_params params = {
        .results = m->results, .directory = m->output, .bake = m->directory, .factors = &m->factors};
    int status;
    KILN_TRY(kiln_publish_batch_create(&params.batch, error));
    for (size_t i = (size_t)m->rank; i < m->map_count; i += (size_t)m->ranks)
        KILN_TRY(kiln_mix_map(&params, m->maps[i].name, m->maps[i].object, &m->ratios[i], error));
    KILN_TRY(kiln_publish_batch_finish(params.batch, error));
end:
    kiln_publish_batch_destroy(&params.batch);
    return status;
}

static int copy_bytes(int from, const char *from_path, int to, const char *to_path, struct kiln_error *error)
{
    enum { AT_ONCE = 1 << 20 };
    char *bytes = NULL;
    int status = kiln_allocate(&bytes, AT_ONCE, 1, "a file's bytes", error);
    for (size_t at = 0; status == KILN_OK;) {
        const ssize_t got = read(from, bytes, AT_ONCE);
        if (got < 0 && errno == EINTR)
            continue;
        if (got < 0)
            status = kiln_fail_errno(error, KILN_IO, "'%s' cannot be read", from_path);
        if (got <= 0)
            break;
        status = kiln_write_all(to, bytes, (size_t)got, at, to_path, error);
        at += (size_t)got;
    }
    kiln_free(&bytes);
    return status;
}

static int copy_file(const struct mix *m, const char *name, struct kiln_error *error)
{
    struct kiln_publish p = {0};
    char path[KILN_PATH_SIZE];
    int from = -1, to = -1;
    int status = kiln_results_file(m->results, name, &from, path, error);
    if (status != KILN_OK)
        return status;
    KILN_TRY(kiln_publish_begin(&p, m->output, name, error));
    KILN_TRY(kiln_publish_open(&p, &to, error));
    KILN_TRY(copy_bytes(from, path, to, p.path, error));
end:
    if (to >= 0)
        (void)close(to);
    if (status == KILN_OK)
        status = kiln_publish_finish(&p, error);
    else
        kiln_publish_abandon(&p);
    kiln_publish_close(&p);
    (void)close(from);
    return status;
}

/* Changes the bake's report into that of the mixture: removes the parts about light and errors, which no longer
 * hold. */
static void change_report(const struct mix *m)
{
    static const char *const gone[] = {"vertices", "energy", "error", "density",   "phases",
                                       "rays",     "memory", "mpi",   "transport", "relight"};
    for (size_t i = 0; i < sizeof gone / sizeof *gone; i++)
        (void)json_object_del(m->run, gone[i]);
    for (size_t i = 0; i < m->map_count; i++) {
        json_t *object = (json_t *)(uintptr_t)m->maps[i].object;
        const double mean = json_number_value(json_object_get(object, "mean"));
        (void)json_object_del(object, "relative_error");
        (void)json_object_del(object, "mean_error");
        if (!m->maps[i].back)
            (void)json_object_set_new(object, "mean", json_real(mean * m->ratios[i]));
    }
    (void)json_object_set_new(m->run, "output", kiln_json_string(m->output));
    (void)json_object_set_new(m->run, "seconds", json_real(MPI_Wtime() - m->begin));
    (void)json_object_set_new(m->run, "mix",
                              json_pack("{s:o, s:o, s:O}", "from", kiln_json_string(m->directory), "factors",
                                        kiln_mix_factors_json(&m->factors), "shown_as_baked", m->as_baked));
}

/* Rank 0. Scene, links and report. */
static int write_others(const struct mix *m, struct kiln_error *error)
{
    int status = kiln_mix_scene_write(m->output, m->results, m->run, &m->factors, m->as_baked, error);
    for (size_t i = 0; status == KILN_OK && i < m->scene_count; i++)
        status = copy_file(m, m->scenes[i], error);
    if (status == KILN_OK)
        status = kiln_mix_preview(m->output, m->job, m->run, error);
    if (status != KILN_OK)
        return status;
    change_report(m);
    char *text = json_dumps(m->run, JSON_INDENT(2));
    status = text == NULL ? kiln_fail(error, KILN_SYSTEM, "out of memory: run.json")
                          : kiln_publish_bytes_below(m->output, "run.json", text, strlen(text), error);
    free(text);
    return status;
}

/* Collective. */
static int write_all(struct mix *m, struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_agree(MPI_COMM_WORLD, m->rank == 0 ? make_folders(m, error) : KILN_OK, error));
    KILN_TRY(with_manifest(m, false, error));
    KILN_TRY(kiln_agree(MPI_COMM_WORLD, mix_maps(m, error), error));
    /* each rank has the values of its own maps, and 0 for others */
    (void)MPI_Reduce(m->rank == 0 ? MPI_IN_PLACE : m->ratios, m->ratios, (int)m->map_count, MPI_DOUBLE, MPI_SUM, 0,
                     MPI_COMM_WORLD);
    const struct kiln_mix_params params = {
        .results = m->results, .directory = m->output, .bake = m->directory, .factors = &m->factors};
    KILN_TRY(kiln_mix_volume(&params, m->run, m->has_volume, MPI_COMM_WORLD, error));
    KILN_TRY(kiln_agree(MPI_COMM_WORLD, m->rank == 0 ? write_others(m, error) : KILN_OK, error));
    KILN_TRY(with_manifest(m, true, error));
end:
    return status;
}

static int tell(const struct mix *m, struct kiln_error *error)
{
    if (m->rank != 0)
        return KILN_OK;
    if (m->job->json)
        return kiln_json_print(json_pack("{s:s, s:o, s:I, s:I, s:f}", "status", "done", "output",
                                         kiln_json_string(m->output), "lightmaps", (json_int_t)m->map_count, "groups",
                                         (json_int_t)m->factors.count, "seconds", MPI_Wtime() - m->begin),
                               error);
    if (!m->job->quiet)
        kiln_print(stdout, "%s: %zu lightmaps, mixed of %zu groups of lights\n", m->output, m->map_count,
                   m->factors.count);
    if (!m->job->quiet && json_array_size(m->as_baked) > 0)
        kiln_print(
            stdout, "NOTE views show %s%s with the brightness that the bake had: its parts have different factors\n",
            json_string_value(json_array_get(m->as_baked, 0)), json_array_size(m->as_baked) > 1 ? " and others" : "");
    return KILN_OK;
}

int kiln_command_mix(struct kiln_job *job, struct kiln_error *error)
{
    struct mix m = {.job = job,
                    .directory = job->arguments[0],
                    .output = job->output,
                    .as_baked = json_array(),
                    .begin = MPI_Wtime()};
    (void)MPI_Comm_rank(MPI_COMM_WORLD, &m.rank);
    (void)MPI_Comm_size(MPI_COMM_WORLD, &m.ranks);
    int status = open_bake(&m, error);
    if (status == KILN_OK)
        status = check_output(&m, error);
    status = kiln_agree(MPI_COMM_WORLD, status, error);
    if (status == KILN_OK)
        status = write_all(&m, error);
    if (status == KILN_OK)
        status = tell(&m, error);
    kiln_mix_factors_release(&m.factors);
    kiln_free(&m.maps);
    kiln_free(&m.scenes);
    kiln_free(&m.ratios);
    json_decref(m.as_baked);
    json_decref(m.run);
    kiln_results_close(&m.results);
    kiln_output_folder_end(&m.folder, status == KILN_OK);
    return status;
}
