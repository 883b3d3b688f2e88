/* kiln submit: submits bakes as jobs to a Slurm cluster. */
#include <errno.h>
#include <glob.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "coordinator/batch/batch.h"
#include "coordinator/cli/commands.h"
#include "coordinator/job/job_private.h"
#include "coordinator/files/json.h"
#include "coordinator/files/publish.h"
#include "worker/backend/extended.h"
#include "worker/base/memory.h"

struct submission {
    struct kiln_job *job; /* owns the strings */
    glob_t found;         /* files that match --array */
    bool globbed;
    char folder[KILN_PATH_SIZE], program[KILN_PATH_SIZE], mpirun[KILN_PATH_SIZE];
    struct kiln_batch_item *items;
    struct kiln_batch_job batch;
    bool embree; /* a job file names the backend embree, which needs no GPU */
    char *script;
    size_t script_length;
    char *id;
};

/* Makes the path absolute; the job owns it. */
static int keep_absolute(struct submission *s, const char *path, const char **kept, struct kiln_error *error)
{
    char *copy = NULL;
    const int status = kiln_job_keep_path(s->job, path, s->folder, &copy, error);
    *kept = copy;
    return status;
}

/* Parses the job as `kiln bake` will, so that a wrong job file is refused now and not when the job starts. */
static int read_item(struct submission *s, const char *path, struct kiln_batch_item *item, struct kiln_error *error)
{
    char bake[] = "bake", output[] = "--output", end[] = "--";
    char *with[] = {bake, bake, output, s->job->output, end, (char *)(uintptr_t)path, NULL};
    char *without[] = {bake, bake, end, (char *)(uintptr_t)path, NULL};
    struct kiln_job *job = NULL;
    int status =
        s->job->output != NULL ? kiln_job_parse(&job, 6, with, error) : kiln_job_parse(&job, 4, without, error);
    struct stat scene;
    KILN_TRY(status);
    if (stat(job->scene.file, &scene) != 0)
        KILN_TRY(
            kiln_fail_errno(error, errno == ENOTDIR ? KILN_NO_INPUT : 0, "cannot read scene %.500s", job->scene.file));
    if (!S_ISREG(scene.st_mode))
        KILN_TRY(kiln_fail(error, KILN_BAD_INPUT, "scene %.500s is not a file", job->scene.file));
    KILN_TRY(kiln_job_parts_check(job, error));
    KILN_TRY(keep_absolute(s, path, &item->job, error));
    KILN_TRY(keep_absolute(s, job->output, &item->output, error));
end:
    s->embree = s->embree || (status == KILN_OK && !kiln_backend_may_use_device(job->machine.backend));
    kiln_job_destroy(&job);
    return status;
}

static int find_array(struct submission *s, struct kiln_error *error)
{
    if (s->job->submit.array == NULL)
        return KILN_OK;
    const int failure = glob(s->job->submit.array, 0, NULL, &s->found);
    s->globbed = failure == 0;
    if (failure == GLOB_NOSPACE)
        return kiln_fail(error, KILN_SYSTEM, "out of memory for the files of --array");
    return failure == 0 ? KILN_OK
                        : kiln_fail(error, KILN_NO_INPUT, "--array: no file is called '%.500s'", s->job->submit.array);
}

/* Refuses two bakes into the same folder, since each would use the other's checkpoints. */
static int check_outputs(const struct submission *s, struct kiln_error *error)
{
    for (size_t i = 0; i < s->batch.item_count; i++)
        for (size_t j = 0; j < i; j++)
            if (strcmp(s->items[i].output, s->items[j].output) == 0)
                return kiln_fail(error, KILN_USAGE,
                                 "%.400s and %.400s would both bake into %.400s; give each its own `output`",
                                 s->items[j].job, s->items[i].job, s->items[i].output);
    return KILN_OK;
}

static int read_items(struct submission *s, struct kiln_error *error)
{
    const size_t given = s->job->argument_count, found = s->globbed ? s->found.gl_pathc : 0;
    if (given + found == 0)
        return kiln_fail(
            error, KILN_USAGE,
            "kiln submit needs a job file or a scene; for example: kiln submit jobs/cornell.yaml --nodes 2");
    int status = kiln_allocate(&s->items, given + found, sizeof *s->items, "the jobs", error);
    for (size_t i = 0; i < given + found && status == KILN_OK; i++)
        status = read_item(s, i < given ? s->job->arguments[i] : s->found.gl_pathv[i - given], &s->items[i], error);
    s->batch.items = s->items;
    s->batch.item_count = given + found;
    return status != KILN_OK ? status : check_outputs(s, error);
}

/* Finds the program that the batch script starts: the launcher of a relocatable folder with its own mpirun, or this
 * program with the mpirun in PATH. */
static int find_program(struct submission *s, struct kiln_error *error)
{
    if (getcwd(s->folder, sizeof s->folder) == NULL)
        return kiln_fail_errno(error, KILN_SYSTEM, "cannot tell the current folder");
    const char *launcher = getenv("KILN_LAUNCHER");
    const char *slash =
        launcher != NULL && launcher[0] == '/' && strlen(launcher) < KILN_PATH_SIZE ? strrchr(launcher, '/') : NULL;
    if (slash != NULL) {
        char folder[KILN_PATH_SIZE];
        (void)snprintf(s->program, sizeof s->program, "%s", launcher);
        (void)snprintf(folder, sizeof folder, "%.*s", (int)(slash - launcher), launcher);
        return kiln_path_join(s->mpirun, folder, "mpirun", error);
    }
    (void)snprintf(s->mpirun, sizeof s->mpirun, "mpirun");
    const ssize_t length = readlink("/proc/self/exe", s->program, sizeof s->program - 1);
    return length > 0 ? KILN_OK : kiln_fail_errno(error, KILN_SYSTEM, "cannot tell where kiln itself is");
}

static int describe(struct submission *s, struct kiln_error *error)
{
    const struct kiln_job *job = s->job;
    s->batch.program = s->program;
    s->batch.mpirun = s->mpirun;
    s->batch.folder = s->folder;
    s->batch.time = job->submit.time_limit;
    s->batch.partition = job->submit.queue;
    s->batch.account = job->submit.account;
    s->batch.nodes = job->submit.nodes;
    s->batch.gpus = job->submit.gpus;
    s->batch.ranks_per_node = job->submit.ranks_per_node != 0 ? job->submit.ranks_per_node
                              : job->submit.gpus != 0         ? job->submit.gpus
                                                              : 1;
    s->batch.threads = job->machine.threads;
    s->batch.memory = job->submit.memory;
    s->batch.warning = job->submit.warning;
    s->batch.tries = job->submit.tries;
    s->batch.backend = job->submit.gpus != 0 ? "vulkan" : NULL;
    if (job->submit.gpus != 0 && s->embree)
        return kiln_fail(error, KILN_USAGE, "--gpus %u, but a job file says `backend: embree`; leave one of them out",
                         job->submit.gpus);
    return job->submit.setup == NULL ? KILN_OK : keep_absolute(s, job->submit.setup, &s->batch.setup, error);
}

static int write_script(struct submission *s, struct kiln_error *error)
{
    FILE *stream = open_memstream(&s->script, &s->script_length);
    if (stream == NULL)
        return kiln_fail(error, KILN_SYSTEM, "out of memory for the batch script");
    const int status = kiln_batch_write(stream, &s->batch, error);
    if (fclose(stream) != 0 && status == KILN_OK)
        return kiln_fail(error, KILN_SYSTEM, "out of memory for the batch script");
    return status;
}

static void print_word(const char *text)
{
    kiln_batch_quote(stdout, text);
    (void)fputc('\n', stdout);
}

static void say(const struct submission *s)
{
    const bool array = s->batch.item_count > 1;
    (void)printf("job %s is in the queue: %zu bake%s, on %u node%s with %u rank%s each\n\n", s->id, s->batch.item_count,
                 array ? "s" : "", s->batch.nodes, s->batch.nodes == 1 ? "" : "s", s->batch.ranks_per_node,
                 s->batch.ranks_per_node == 1 ? "" : "s");
    (void)printf("  squeue -j %s\n  tail -F kiln-%s%s.log\n", s->id, s->id, array ? "_0" : "");
    (void)printf("  kiln status ");
    print_word(s->items[0].output);
    (void)printf("  scancel %s\n\nA bake that the time limit or a lost node ends goes back into the queue by itself "
                 "and goes on from its last checkpoint.\n",
                 s->id);
}

static int say_json(const struct submission *s, struct kiln_error *error)
{
    json_t *outputs = json_array();
    for (size_t i = 0; i < s->batch.item_count; i++)
        (void)json_array_append_new(outputs, kiln_json_string(s->items[i].output));
    json_t *object = json_pack("{s:s, s:o}", "status", "done", "outputs", outputs);
    if (s->id != NULL)
        (void)json_object_set_new(object, "job", json_string(s->id));
    else
        (void)json_object_set_new(object, "script", kiln_json_string(s->script));
    return kiln_json_print(object, error);
}

static int finish(struct submission *s, struct kiln_error *error)
{
    if (!s->job->submit.dry_run) {
        const int status = kiln_batch_submit(s->script, s->script_length, &s->id, error);
        if (status != KILN_OK)
            return status;
    }
    if (s->job->json)
        return say_json(s, error);
    if (s->job->submit.dry_run)
        (void)fwrite(s->script, 1, s->script_length, stdout);
    else if (!s->job->quiet)
        say(s);
    return KILN_OK;
}

int kiln_command_submit(struct kiln_job *job, struct kiln_error *error)
{
    struct submission s = {.job = job};
    int status;
    KILN_TRY(find_program(&s, error));
    KILN_TRY(find_array(&s, error));
    KILN_TRY(read_items(&s, error));
    KILN_TRY(describe(&s, error));
    KILN_TRY(write_script(&s, error));
    KILN_TRY(finish(&s, error));
end:
    if (s.globbed)
        globfree(&s.found);
    kiln_free(&s.items);
    free(s.script);
    free(s.id);
    return status;
}
