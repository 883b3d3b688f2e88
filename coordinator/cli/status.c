/* kiln status DIR: prints the progress of a bake, whether it is alive, and what to do next. */
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>

#include "coordinator/run/checkpoint.h"
#include "coordinator/run/status_file.h"
#include "coordinator/cli/commands.h"
#include "coordinator/files/json.h"
#include "coordinator/run/progress.h"
#include "coordinator/files/publish.h"
#include "worker/base/text.h"

/* Facts known about the bake, and its state: running, lost, stopped, failed or done. */
struct found {
    struct kiln_bake_status status;
    const char *state;
    bool has_generation;
    uint64_t generation;
    double now;
};

static bool is_done(const char *directory)
{
    char path[KILN_PATH_SIZE];
    struct stat there;
    return kiln_path_join(path, directory, "run.json", NULL) == KILN_OK && stat(path, &there) == 0;
}

static int look(const char *directory, struct found *f, struct kiln_error *error)
{
    *f = (struct found){.now = (double)time(NULL)};
    const int status = kiln_bake_status_read(directory, &f->status, error);
    f->has_generation = kiln_checkpoint_newest(directory, &f->generation);
    if (status == KILN_OK) {
        const bool running = strcmp(f->status.state, "running") == 0;
        f->state = !running ? f->status.state : kiln_bake_status_alive(directory, &f->status) ? "running" : "lost";
        return KILN_OK;
    }
    f->status.phase_share = f->status.share = f->status.left = -1.0;
    if (f->has_generation)
        f->state = "lost";
    else if (is_done(directory))
        f->state = "done";
    else
        return kiln_fail(error, KILN_NO_INPUT,
                         "there is no bake in %.500s: neither a running one, nor a checkpoint, nor run.json",
                         directory);
    return KILN_OK;
}

static const char *advice(const struct found *f)
{
    if (strcmp(f->state, "running") == 0)
        return "kiln stop DIR saves and ends it";
    if (strcmp(f->state, "done") == 0)
        return "kiln report DIR, kiln view DIR";
    return f->has_generation ? "the same command goes on from the checkpoint" : "the same command starts again";
}

/* Prints the state as JSON. "status" has the values of the bake's own last object (done, stopped); "state" is its
 * former name. */
static int print_json(const struct found *f, struct kiln_error *error)
{
    const struct kiln_bake_status *s = &f->status;
    json_t *json = json_pack("{s:o, s:o}", "status", kiln_json_string(f->state), "state", kiln_json_string(f->state));
    if (s->state[0] != '\0') {
        json_t *more = json_pack("{s:o, s:f, s:i, s:o, s:I, s:f}", "phase", kiln_json_string(s->phase), "seconds",
                                 s->seconds, "ranks", (int)s->ranks, "host", kiln_json_string(s->host), "process",
                                 (json_int_t)s->process, "seconds_since_sign_of_life", fmax(0.0, f->now - s->updated));
        (void)json_object_update(json, more);
        json_decref(more);
    }
    if (s->phase_share >= 0.0)
        (void)json_object_set_new(json, "phase_share", json_real(s->phase_share));
    if (s->share >= 0.0)
        (void)json_object_set_new(json, "share", json_real(s->share));
    if (s->left >= 0.0 && strcmp(f->state, "running") == 0)
        (void)json_object_set_new(json, "seconds_left", json_real(s->left));
    if (f->has_generation)
        (void)json_object_set_new(json, "checkpoint", json_integer((json_int_t)f->generation));
    if (s->saved > 0.0)
        (void)json_object_set_new(json, "checkpoint_age", json_real(fmax(0.0, f->now - s->saved)));
    if (s->message[0] != '\0') {
        (void)json_object_set_new(json, "code", json_integer(s->code));
        (void)json_object_set_new(json, "message", kiln_json_string(s->message));
    }
    (void)json_object_set_new(json, "next", json_string(advice(f)));
    return kiln_json_print(json, error);
}

static void print_phase(const struct found *f)
{
    const struct kiln_bake_status *s = &f->status;
    char duration[48], share[32] = "";
    if (s->phase_share >= 0.0)
        (void)snprintf(share, sizeof share, ", %.0f %% of it", 100.0 * s->phase_share);
    kiln_print(stdout, "phase        %s%s\n", s->phase, share);
    if (s->share >= 0.0 && s->left >= 0.0 && strcmp(f->state, "running") == 0)
        (void)printf("done         %.0f %%, %s left\n", 100.0 * s->share,
                     kiln_duration_text(s->left, duration, sizeof duration));
    (void)printf("running for  %s", kiln_duration_text(s->seconds, duration, sizeof duration));
    (void)printf("; last sign of life %s ago\n",
                 kiln_duration_text(fmax(0.0, f->now - s->updated), duration, sizeof duration));
}

static void print_text(const struct found *f)
{
    const struct kiln_bake_status *s = &f->status;
    char text[48];
    if (s->state[0] != '\0')
        kiln_print(stdout, "state        %s, %d rank%s, rank 0 is process %lld on %s\n", f->state, s->ranks,
                   s->ranks == 1 ? "" : "s", (long long)s->process, s->host);
    else
        kiln_print(stdout, "state        %s\n", f->state);
    if (s->phase[0] != '\0')
        print_phase(f);
    if (f->has_generation && s->saved > 0.0)
        (void)printf("checkpoint   %llu, %s ago\n", (unsigned long long)f->generation,
                     kiln_duration_text(fmax(0.0, f->now - s->saved), text, sizeof text));
    else
        (void)printf(f->has_generation ? "checkpoint   %llu\n" : "checkpoint   none\n",
                     (unsigned long long)f->generation);
    if (s->message[0] != '\0')
        kiln_print(stdout, "ended        with %d: %s\n", s->code, s->message);
    (void)printf("next         %s\n", advice(f));
}

int kiln_command_status(struct kiln_job *job, struct kiln_error *error)
{
    struct found found;
    const int status = look(job->arguments[0], &found, error);
    if (status != KILN_OK)
        return status;
    if (job->json)
        return print_json(&found, error);
    if (!job->quiet)
        print_text(&found);
    return KILN_OK;
}
