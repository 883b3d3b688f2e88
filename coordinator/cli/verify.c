/* kiln verify DIR: whether every file of a finished bake is as it was written, and holds what it can hold. */
#include <jansson.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/cli/commands.h"
#include "coordinator/cli/json.h"
#include "coordinator/output/manifest.h"
#include "coordinator/output/publish.h"
#include "coordinator/output/ranges.h"
#include "worker/base/memory.h"

struct verdict {
    int status;
    struct kiln_error error;
};

/* Only what is as it was written is looked into. HDF5 is not for several threads: those files wait for one another. */
static void check_file(const struct kiln_manifest_file *file, const char *directory, struct verdict *verdict)
{
    char path[KILN_PATH_SIZE];
    const char *dot = strrchr(file->path, '.');
    verdict->status = kiln_manifest_check(file, directory, &verdict->error);
    if (verdict->status == KILN_OK)
        verdict->status = kiln_path_join(path, directory, file->path, &verdict->error);
    if (verdict->status != KILN_OK)
        return;
    if (dot != NULL && (strcmp(dot, ".h5") == 0 || strcmp(dot, ".hdf") == 0)) {
#pragma omp critical(kiln_verify_h5)
        verdict->status = kiln_ranges_check(path, &verdict->error);
    } else {
        verdict->status = kiln_ranges_check(path, &verdict->error);
    }
}

static int check_all(const struct kiln_manifest *m, const char *directory, struct verdict **verdicts, struct kiln_error *error)
{
    const int status = kiln_allocate(verdicts, m->count, sizeof **verdicts, "the files' verdicts", error);
    if (status != KILN_OK)
        return status;
    struct verdict *v = *verdicts;
#pragma omp parallel for schedule(dynamic, 1)
    for (size_t i = 0; i < m->count; i++)
        check_file(&m->files[i], directory, &v[i]);
    return KILN_OK;
}

static int print_json(struct kiln_job *job, const struct kiln_manifest *m, const struct verdict *v, size_t bad, uint64_t bytes, struct kiln_error *error)
{
    json_t *problems = json_array();
    for (size_t i = 0; i < m->count; i++)
        if (v[i].status != KILN_OK)
            (void)json_array_append_new(problems, json_pack("{s:o, s:o}", "file", kiln_json_string(m->files[i].path), "message",
                                                            kiln_json_string(v[i].error.message)));
    job->answered = true;
    return kiln_json_print(json_pack("{s:s, s:I, s:I, s:I, s:o}", "status", bad == 0 ? "done" : "damaged", "files", (json_int_t)m->count, "bytes",
                                     (json_int_t)bytes, "damaged", (json_int_t)bad, "problems", problems), error);
}

static int conclude(struct kiln_job *job, const struct kiln_manifest *m, const struct verdict *v, struct kiln_error *error)
{
    size_t bad = 0;
    uint64_t bytes = 0;
    const char *first = NULL;
    for (size_t i = 0; i < m->count; i++) {
        bytes += m->files[i].bytes;
        bad += v[i].status != KILN_OK;
        if (v[i].status == KILN_OK)
            continue;
        first = first != NULL ? first : m->files[i].path;
        if (!job->json)
            (void)printf("%s\n", v[i].error.message);
    }
    const int status = job->json ? print_json(job, m, v, bad, bytes, error) : KILN_OK;
    if (bad > 0)
        return kiln_fail(error, KILN_BAD_INPUT, "%zu of %zu files in %.500s cannot be trusted, %.200s first; bake again", bad, m->count,
                         job->arguments[0], first);
    if (!job->json && !job->quiet)
        (void)printf("%zu files, %.1f MiB: all as they were written, all values in range\n", m->count, (double)bytes / 1048576.0);
    return status;
}

int kiln_command_verify(struct kiln_job *job, struct kiln_error *error)
{
    struct kiln_manifest *manifest = NULL;
    struct verdict *verdicts = NULL;
    const char *directory = job->arguments[0];
    int status = kiln_manifest_read(&manifest, directory, error);
    if (status == KILN_NO_INPUT)
        status = kiln_fail(error, KILN_NO_INPUT, "%.500s has no manifest: the bake in it is not finished (kiln status says where it is)", directory);
    if (status == KILN_OK)
        status = check_all(manifest, directory, &verdicts, error);
    if (status == KILN_OK)
        status = conclude(job, manifest, verdicts, error);
    kiln_free(&verdicts);
    kiln_manifest_destroy(&manifest);
    return status;
}
