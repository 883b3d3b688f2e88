#include "coordinator/cli/view_shots.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "worker/base/memory.h"

enum { LABEL_SIZE = 120, FRAMES_A_KEY = 24, MOST_FRAMES = 100000 };

/* ---- options ---- */

static int read_point(const char *option, const char *text, double point[3], struct kiln_error *error)
{
    char after;
    if (sscanf(text, "%lf,%lf,%lf%c", &point[0], &point[1], &point[2], &after) != 3)
        return kiln_fail(error, KILN_USAGE, "--%s %s: it must be three numbers separated by commas, such as 1,1.5,3",
                         option, text);
    return KILN_OK;
}

static int allocate(struct kiln_shots *shots, size_t count, struct kiln_error *error)
{
    int status = kiln_allocate(&shots->wishes, count, sizeof *shots->wishes, "views", error);
    if (status == KILN_OK)
        status = kiln_allocate(&shots->frames, count, sizeof *shots->frames, "views", error);
    shots->count = status == KILN_OK ? count : 0;
    return status;
}

/* Sets the members that all pictures have in common. */
static int common(const struct kiln_job *job, struct kiln_shots *shots, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; status == KILN_OK && i < shots->count; i++) {
        struct kiln_view_wish *wish = &shots->wishes[i];
        struct kiln_camera_frame *frame = &shots->frames[i];
        wish->field_of_view = job->view.field_of_view;
        wish->width = job->view.width;
        wish->height = job->view.height;
        if (job->view.from != NULL && (status = read_point("from", job->view.from, frame->from, error)) == KILN_OK)
            wish->from = frame->from;
        if (status == KILN_OK && job->view.to != NULL &&
            (status = read_point("to", job->view.to, frame->to, error)) == KILN_OK)
            wish->to = frame->to;
    }
    return status;
}

/* ---- cameras ---- */

static int all_cameras(const struct kiln_job *job, const struct kiln_scene *scene, struct kiln_shots *shots,
                       struct kiln_error *error)
{
    if (scene->camera_count == 0)
        return kiln_fail(error, KILN_USAGE,
                         "--camera all: the scene has no cameras; --from X,Y,Z --to X,Y,Z says where to look from");
    int status;
    KILN_TRY(allocate(shots, scene->camera_count, error));
    KILN_TRY(common(job, shots, error));
    for (size_t i = 0; i < shots->count; i++)
        shots->wishes[i].camera = &scene->cameras[i];
end:
    return status;
}

/* Takes the cameras of a list of names that are separated by commas. */
static int list_cameras(const struct kiln_job *job, const struct kiln_scene *scene, struct kiln_shots *shots,
                        struct kiln_error *error)
{
    size_t count = 1, index = 0;
    char *names = strdup(job->view.camera);
    if (names == NULL)
        return kiln_fail(error, KILN_SYSTEM, "out of memory for the names of cameras");
    for (const char *c = names; *c != '\0'; c++)
        count += *c == ',';
    int status;
    KILN_TRY(allocate(shots, count, error));
    KILN_TRY(common(job, shots, error));
    for (char *name = names, *after; name != NULL; name = after) {
        after = strchr(name, ',');
        if (after != NULL)
            *after++ = '\0';
        KILN_TRY(kiln_view_find_camera(scene, name, &shots->wishes[index++].camera, error));
    }
end:
    free(names);
    return status;
}

static bool is_a_camera(const struct kiln_scene *scene, const char *name)
{
    const struct kiln_camera *camera;
    return kiln_view_find_camera(scene, name, &camera, NULL) == KILN_OK;
}

static int cameras(const struct kiln_job *job, const struct kiln_scene *scene, struct kiln_shots *shots,
                   struct kiln_error *error)
{
    if (job->view.camera != NULL && !is_a_camera(scene, job->view.camera)) {
        const bool all = strcmp(job->view.camera, "all") == 0;
        if ((all || strchr(job->view.camera, ',') != NULL) && job->view.from != NULL)
            return kiln_fail(error, KILN_USAGE,
                             "--camera %.200s --from %.200s: all pictures would be the same; leave "
                             "one of the two out",
                             job->view.camera, job->view.from);
        shots->kind = KILN_SHOTS_CAMERAS;
        if (all)
            return all_cameras(job, scene, shots, error);
        if (strchr(job->view.camera, ',') != NULL)
            return list_cameras(job, scene, shots, error);
    }
    shots->kind = KILN_SHOTS_ONE;
    int status;
    KILN_TRY(allocate(shots, 1, error));
    if (job->view.camera != NULL)
        KILN_TRY(kiln_view_find_camera(scene, job->view.camera, &shots->wishes[0].camera, error));
    KILN_TRY(common(job, shots, error));
end:
    return status;
}

/* ---- paths ---- */

static int refuse_beside_path(const struct kiln_job *job, struct kiln_error *error)
{
    const char *other = job->view.camera != NULL ? "camera"
                        : job->view.from != NULL ? "from"
                        : job->view.to != NULL   ? "to"
                                                 : NULL;
    if (other == NULL)
        return KILN_OK;
    return kiln_fail(error, KILN_USAGE, "--path and --%s: the path says where to look from; leave --%s out", other,
                     other);
}

/* The number of frames that are asked for. */
static int frame_count(const struct kiln_job *job, const struct kiln_camera_path *path, size_t *count,
                       struct kiln_error *error)
{
    *count = job->view.frames != 0 ? job->view.frames : FRAMES_A_KEY * (kiln_camera_path_keys(path) - 1) + 1;
    return *count <= MOST_FRAMES
               ? KILN_OK
               : kiln_fail(
                     error, KILN_BAD_INPUT,
                     "%.500s: %zu key frames would be %zu frames, and there are at most %d; --frames N says how many",
                     job->view.path, kiln_camera_path_keys(path), *count, MOST_FRAMES);
}

static int frames(const struct kiln_job *job, struct kiln_shots *shots, struct kiln_error *error)
{
    struct kiln_camera_path *path = NULL;
    size_t count = 0;
    int status;
    KILN_TRY(refuse_beside_path(job, error));
    KILN_TRY(kiln_camera_path_read(&path, job->view.path, error));
    KILN_TRY(frame_count(job, path, &count, error));
    KILN_TRY(allocate(shots, count, error));
    KILN_TRY(common(job, shots, error));
    for (size_t i = 0; i < shots->count; i++) {
        kiln_camera_path_frame(path, i, shots->count, &shots->frames[i]);
        shots->wishes[i].from = shots->frames[i].from;
        shots->wishes[i].to = shots->frames[i].to;
        if (shots->frames[i].field_of_view > 0.0)
            shots->wishes[i].field_of_view = shots->frames[i].field_of_view;
    }
end:
    kiln_camera_path_destroy(&path);
    return status;
}

/* ---- names of files ---- */

/* Makes a camera's name fit for a file name. */
static void plain_name(const struct kiln_scene *scene, const struct kiln_camera *camera, char label[LABEL_SIZE])
{
    static const char kept[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.-_";
    (void)snprintf(label, LABEL_SIZE, "%.100s", kiln_scene_string(scene, camera->name));
    for (char *c = label; *c != '\0'; c++)
        if (strchr(kept, *c) == NULL)
            *c = '_';
}

/* Whether two cameras would have the same file, on file systems that take capitals for small letters, too. */
static bool names_meet(const struct kiln_shots *shots, const struct kiln_scene *scene)
{
    char one[LABEL_SIZE], other[LABEL_SIZE];
    for (size_t i = 0; i < shots->count; i++) {
        plain_name(scene, shots->wishes[i].camera, one);
        for (size_t k = 0; k < i; k++) {
            plain_name(scene, shots->wishes[k].camera, other);
            if (strcasecmp(one, other) == 0)
                return true;
        }
    }
    return false;
}

int kiln_shots_make(const struct kiln_job *job, const struct kiln_scene *scene, const char *output,
                    struct kiln_shots *shots, struct kiln_error *error)
{
    *shots = (struct kiln_shots){.output = output};
    if (job->view.path == NULL && job->view.frames != 0)
        return kiln_fail(error, KILN_USAGE, "--frames %u: there is no path to divide; --path FILE.csv names one",
                         job->view.frames);
    if (job->view.path == NULL) {
        const int status = cameras(job, scene, shots, error);
        shots->numbered = status == KILN_OK && shots->kind == KILN_SHOTS_CAMERAS && names_meet(shots, scene);
        return status;
    }
    shots->kind = KILN_SHOTS_PATH;
    return frames(job, shots, error);
}

void kiln_shots_destroy(struct kiln_shots *shots)
{
    kiln_free(&shots->wishes);
    kiln_free(&shots->frames);
    shots->count = 0;
}

static void camera_label(const struct kiln_shots *shots, const struct kiln_scene *scene, size_t index,
                         char label[LABEL_SIZE])
{
    plain_name(scene, shots->wishes[index].camera, label);
    const size_t length = strlen(label);
    if (shots->numbered)
        (void)snprintf(label + length, LABEL_SIZE - length, "-%zu", index + 1);
}

int kiln_shots_path(const struct kiln_shots *shots, const struct kiln_scene *scene, size_t index,
                    char path[KILN_PATH_SIZE], struct kiln_error *error)
{
    char label[LABEL_SIZE] = "";
    const char *dot = strrchr(shots->output, '.');
    if (shots->kind == KILN_SHOTS_CAMERAS)
        camera_label(shots, scene, index, label);
    else if (shots->kind == KILN_SHOTS_PATH)
        (void)snprintf(label, sizeof label, "%0*zu", shots->count > 9999 ? 6 : 4, index + 1);
    const int length = snprintf(path, KILN_PATH_SIZE, "%.*s%s%s%s", (int)(dot - shots->output), shots->output,
                                label[0] != '\0' ? "-" : "", label, dot);
    return length > 0 && length < KILN_PATH_SIZE
               ? KILN_OK
               : kiln_fail(error, KILN_USAGE, "--output %.200s: the names of the pictures would be too long",
                           shots->output);
}
