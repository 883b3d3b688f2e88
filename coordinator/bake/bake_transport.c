/* Transport kept beside the bake, in OUTPUT/transport, or replayed from the folder of another bake. The index in the
 * folder (transport_identity.h) is written once all light is computed. */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/bake/bake_private.h"
#include "coordinator/bake/identity/transport_identity.h"
#include "coordinator/files/publish.h"
#include "coordinator/integrate/patches/link_file.h"
#include "coordinator/job/options.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

static const char FOLDER[] = "transport";

/* ---- what cannot be kept ---- */

/* Whether rays go on behind surfaces that they meet, and the backend cannot keep such chains. */
static bool goes_on_elsewhere(const struct kiln_job *job, const struct kiln_prepared *p)
{
    struct kiln_backend_info info;
    kiln_backend_info(p->backend, &info);
    return kiln_transport_goes_on(job, p) && !info.keeps_chains;
}

/* Why the rays of this bake cannot be kept; NULL: they can. */
static const char *why_not(const struct kiln_job *job, const struct kiln_prepared *p)
{
    if (kiln_job_is_reference(job) || kiln_job_is_radiosity(job))
        return "those are kept that --method cells gathers by: leave --method out, or give --patches links and "
               "--keep-transport links";
    if (kiln_job_has_probes(job))
        return "some rays end at radiance probes: leave --tracing-range out";
    if (job->light.guide > 0)
        return "a guide sends rays where the light is: leave --guide out";
    if (goes_on_elsewhere(job, p))
        return "some rays go on from gloss, or are tinted, which Embree alone keeps: give --backend embree";
    if (p->surface->point_count >= (kiln_transport_goes_on(job, p) ? KILN_CHAIN_POINTS : KILN_ROW_POINTS))
        return "there are more surface points than words of rays can tell apart: give fewer --texels-per-metre";
    return NULL;
}

/* Whether the job's transport is links, kept or replayed. */
static bool is_of_links(const struct kiln_job *job)
{
    return job->relighting.folder != NULL ? kiln_job_has_links(job) : job->light.keep == KILN_KEEP_LINKS;
}

static int refuse_what_cannot_be_kept(const struct kiln_job *job, const struct kiln_prepared *p,
                                      struct kiln_error *error)
{
    const char *why = why_not(job, p);
    if (job->relighting.folder != NULL && !is_of_links(job) && why != NULL && !goes_on_elsewhere(job, p))
        return kiln_fail(error, KILN_BAD_INPUT, "the transport in %.300s cannot be of the bake that it names: %s",
                         job->relighting.folder, why);
    if (job->light.keep == KILN_KEEP_LINKS && !kiln_job_has_links(job))
        return kiln_fail(error, KILN_USAGE,
                         "--keep-transport links: this bake has none; give --method radiosity --patches links, or "
                         "--keep-transport rows");
    if (job->light.keep == KILN_KEEP_ROWS && why != NULL)
        return kiln_fail(error, KILN_USAGE, "--keep-transport rows: %s", why);
    if (job->relighting.folder != NULL && !is_of_links(job) && goes_on_elsewhere(job, p))
        return kiln_fail(error, KILN_USAGE,
                         "rays of %.300s go on from gloss, or are tinted, which Embree alone looks up: give --backend "
                         "embree",
                         job->relighting.folder);
    if ((job->relighting.states != NULL || job->relighting.listen) && is_of_links(job))
        return kiln_fail(
            error, KILN_USAGE,
            "%s: %.300s has kept links, which serve one state at a time; leave it out, and call kiln relight "
            "for each",
            job->relighting.listen ? "--listen" : "--states", job->relighting.folder);
    return KILN_OK;
}

/* ---- before the light ---- */

static int make_identity(struct kiln_bake *b, const struct kiln_prepared *p, struct kiln_error *error)
{
    if (b->rank != 0)
        return KILN_OK;
    json_decref(b->transport_identity);
    b->transport_identity = kiln_transport_identity(b->job, p);
    return b->transport_identity != NULL ? KILN_OK : kiln_fail(error, KILN_SYSTEM, "out of memory: the transport");
}

/* Rank 0. Checks that the scene is the one whose transport is replayed. Its light and its colours may differ. */
static int compare_identity(const struct kiln_bake *b, struct kiln_error *error)
{
    json_t *index = NULL;
    int status = kiln_transport_index_read(&index, b->job->relighting.folder, error);
    if (status == KILN_OK)
        status = kiln_transport_compare(json_object_get(index, "identity"), b->transport_identity,
                                        b->job->relighting.folder, error);
    json_decref(index);
    return status;
}

int kiln_bake_transport_check(struct kiln_bake *b, const struct kiln_prepared *p, struct kiln_error *error)
{
    int status = KILN_OK;
    if (b->job->light.keep == KILN_KEEP_NONE && b->job->relighting.folder == NULL)
        return KILN_OK;
    KILN_TRY(refuse_what_cannot_be_kept(b->job, p, error));
    KILN_TRY(make_identity(b, p, error));
    if (b->rank == 0 && b->job->relighting.folder != NULL)
        KILN_TRY(compare_identity(b, error));
end:
    return kiln_agree(b->communicator, status, error);
}

static bool is_kept(const char *name)
{
    return strncmp(name, "rows-", 5) == 0 || strncmp(name, "chains-", 7) == 0 || strcmp(name, KILN_LINK_FILE) == 0;
}

static int remove_files(const struct kiln_folder *folder, bool (*which)(const char *name), struct kiln_error *error)
{
    const int copy = openat(folder->descriptor, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    DIR *list = copy >= 0 ? fdopendir(copy) : NULL;
    int status = KILN_OK;
    if (list == NULL)
        status = kiln_fail_errno(error, 0, "cannot read '%s'", folder->path);
    for (struct dirent *e; list != NULL && status == KILN_OK && (e = readdir(list)) != NULL;)
        if (which(e->d_name) && unlinkat(folder->descriptor, e->d_name, 0) != 0)
            status = kiln_fail_errno(error, KILN_CANNOT_CREATE, "cannot remove '%s/%.200s'", folder->path, e->d_name);
    if (list != NULL)
        (void)closedir(list);
    else if (copy >= 0)
        (void)close(copy);
    return status;
}

/* Rank 0. Clears the folder of transport: a bake that starts from its beginning removes all files that an earlier bake
 * kept; one that resumes adds to them. Either removes the index, which is written anew. */
static int clear_folder(const struct kiln_bake *b, struct kiln_error *error)
{
    static const char index[] = "transport/index";
    if (kiln_unlink_below(b->job->output, index) != 0 && errno != ENOENT)
        return kiln_fail_errno(error, KILN_CANNOT_CREATE, "cannot replace %.300s/%s", b->job->output, index);
    return kiln_checkpoint_generation(b->checkpoint) > 0 ? KILN_OK : remove_files(&b->transport_folder, is_kept, error);
}

int kiln_bake_transport_begin(struct kiln_bake *b, struct kiln_error *error)
{
    const bool keeps = b->job->light.keep != KILN_KEEP_NONE, replays = b->job->relighting.folder != NULL;
    if (!keeps && !replays)
        return KILN_OK;
    const char *directory = replays ? b->job->relighting.folder : b->job->output;
    int status =
        keeps && b->rank == 0 ? kiln_folder_open(&b->transport_folder, directory, FOLDER, true, error) : KILN_OK;
    if (status == KILN_OK && keeps && b->rank == 0)
        status = clear_folder(b, error);
    status = kiln_agree(b->communicator, status, error);
    if (status == KILN_OK && !(keeps && b->rank == 0))
        status = kiln_folder_open(&b->transport_folder, directory, FOLDER, false, error);
    uint64_t key = b->rank == 0 ? kiln_transport_key(b->transport_identity) : 0;
    (void)MPI_Bcast(&key, 1, MPI_UINT64_T, 0, b->communicator);
    b->transport = (struct kiln_transport){.is_on = true,
                                           .replays = replays,
                                           .has_chains = kiln_transport_goes_on(b->job, b->prepared),
                                           .of_links = is_of_links(b->job),
                                           .folder = b->transport_folder.descriptor,
                                           .directory = b->transport_folder.path,
                                           .key = key,
                                           .points = b->prepared->surface->point_count,
                                           .rank = b->rank};
    return kiln_agree(b->communicator, status, error);
}

/* ---- after it ---- */

/* Returns an option's value as JSON. An existing path is made absolute, so that it means the same in any folder; other
 * values stay as they are. */
static json_t *value_json(const struct kiln_option *option, const char *text)
{
    const bool path = option->kind == KILN_OPTION_PATH || option->kind == KILN_OPTION_ENVIRONMENT;
    char *real = path && access(text, F_OK) == 0 ? realpath(text, NULL) : NULL;
    json_t *value = json_string(real != NULL ? real : text);
    free(real);
    return value;
}

/* Returns the options of the job that define its light, as JSON. */
static json_t *job_json(const struct kiln_job *job)
{
    json_t *json = json_object();
    for (size_t i = 0; i < kiln_option_count; i++) {
        char room[KILN_OPTION_TEXT];
        const struct kiln_option *option = &kiln_options[i];
        const char *text = kiln_option_text(job, option, room);
        if (option->kind == KILN_OPTION_FLAG)
            text = strcmp(text, "on") == 0 ? "true" : "false";
        if (option->of_light && (option->commands & KILN_FOR_BAKE) != 0 && strcmp(text, "not given") != 0)
            (void)json_object_set_new(json, option->name, value_json(option, text));
    }
    return json;
}

/* Adds the rules of a file under `key`. `text`: the file as JSON; NULL: there was no file, and nothing is added. */
static bool add_rules(json_t *json, const char *key, const char *text)
{
    return text == NULL || json_object_set_new(json, key, json_loads(text, 0, NULL)) == 0;
}

static int write_index(const struct kiln_bake *b, struct kiln_error *error)
{
    char *text = NULL, *scene = realpath(b->job->scene.file, NULL);
    size_t size = 0;
    json_t *json =
        json_pack("{s:s, s:O, s:s, s:s, s:s, s:o}", "kiln", KILN_VERSION, "identity", b->transport_identity, "scene",
                  scene != NULL ? scene : b->job->scene.file, "backend", kiln_backend_name(b->prepared->backend),
                  "instruction set", b->prepared->instruction_set, "job", job_json(b->asked));
    int status =
        (b->asked->scene.part_count == 0 || json_object_set_new(json, "parts", kiln_job_parts_json(b->asked)) == 0) &&
                add_rules(json, "changes", b->asked->scene.changed) &&
                add_rules(json, "light groups", b->asked->scene.grouped)
            ? kiln_seal(json, JSON_INDENT(1), &text, &size, "the index of the transport", error)
            : kiln_fail(error, KILN_SYSTEM, "out of memory: the index of the transport");
    if (status == KILN_OK)
        status = kiln_publish_bytes_below(b->job->output, "transport/index", text, size, error);
    kiln_free(&text);
    json_decref(json);
    free(scene);
    return status;
}

static int name_file(struct kiln_bake *b, const char *name, struct kiln_error *error)
{
    const size_t room = sizeof FOLDER + strlen(name) + 1;
    char **path = &b->transport_files[b->transport_file_count];
    const int status = kiln_allocate(path, room, 1, "the files of the transport", error);
    if (status == KILN_OK) {
        (void)snprintf(*path, room, "%s/%s", FOLDER, name);
        b->transport_file_count++;
    }
    return status;
}

/* Lists the names of all kept files, the same on all ranks. Those of earlier runs that this run resumes are
 * included. */
static int name_files(struct kiln_bake *b, struct kiln_error *error)
{
    const struct kiln_step_reports *steps = &b->solution->report.steps;
    const bool links = b->transport.of_links;
    bool named = false;
    int status = kiln_allocate(&b->transport_files, 2 * steps->count + 2, sizeof *b->transport_files,
                               "the files of the transport", error);
    for (size_t i = 0; i < steps->count && status == KILN_OK; i++) {
        const struct kiln_step *step = &steps->of[i].step;
        char name[KILN_TRANSPORT_NAME] = KILN_LINK_FILE;
        if (!links)
            kiln_transport_name(step, name);
        if (links ? named || step->pass != &kiln_pass_links || step->bounce == 0 : !kiln_transport_keeps(step))
            continue;
        status = name_file(b, name, error);
        named = true;
        kiln_transport_chains_name(step, name);
        if (status == KILN_OK && !links && b->transport.has_chains)
            status = name_file(b, name, error);
    }
    return status == KILN_OK ? name_file(b, "index", error) : status;
}

/* Collective. Chains of all steps get to where they are read. */
static int pack_chains(struct kiln_bake *b, struct kiln_error *error)
{
    const struct kiln_step_reports *steps = &b->solution->report.steps;
    int status = KILN_OK;
    if (!b->transport.has_chains || b->transport.of_links)
        return KILN_OK;
    for (size_t i = 0; i < steps->count; i++)
        if (kiln_transport_keeps(&steps->of[i].step))
            KILN_TRY(kiln_transport_pack(&b->transport, b->communicator, &steps->of[i].step, error));
    if (b->rank == 0)
        KILN_TRY(remove_files(&b->transport_folder, kiln_transport_is_spool, error));
end:
    return kiln_agree(b->communicator, status, error);
}

int kiln_bake_transport_write(struct kiln_bake *b, struct kiln_error *error)
{
    if (b->job->light.keep == KILN_KEEP_NONE)
        return KILN_OK;
    int status;
    KILN_TRY(pack_chains(b, error));
    KILN_TRY(name_files(b, error));
    if (b->rank == 0)
        KILN_TRY(kiln_folder_sync(&b->transport_folder, error));
    if (b->rank == 0)
        KILN_TRY(write_index(b, error));
end:
    return kiln_agree(b->communicator, status, error);
}

json_t *kiln_bake_transport_json(struct kiln_bake *b)
{
    const struct kiln_transport *t = &b->transport;
    uint64_t rays[] = {t->kept, t->found, t->traced}, all[] = {0, 0, 0};
    if (!t->is_on)
        return NULL;
    (void)MPI_Reduce(rays, all, 3, MPI_UINT64_T, MPI_SUM, 0, b->communicator);
    if (b->rank != 0)
        return NULL;
    const char *keys[] = {t->of_links ? "links_kept" : "rays_kept", t->of_links ? "links_replayed" : "rays_replayed",
                          t->of_links ? "links_traced" : "rays_traced"};
    return t->replays ? json_pack("{s:s, s:I, s:I}", "from", b->job->relighting.folder, keys[1], (json_int_t)all[1],
                                  keys[2], (json_int_t)all[2])
                      : json_pack("{s:s, s:I}", "form", t->of_links ? "links" : "rows", keys[0], (json_int_t)all[0]);
}

void kiln_bake_transport_release(struct kiln_bake *b)
{
    for (size_t i = 0; i < b->transport_file_count; i++)
        kiln_free(&b->transport_files[i]);
    kiln_free(&b->transport_files);
    json_decref(b->transport_identity);
    if (b->transport.is_on)
        kiln_folder_close(&b->transport_folder);
}
