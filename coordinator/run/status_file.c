#include "coordinator/run/status_file.h"

#include <errno.h>
#include <fcntl.h>
#include <jansson.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "coordinator/files/foreign_json.h"
#include "coordinator/files/json.h"
#include "coordinator/files/publish.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"
#include "worker/base/text.h"

#define OLD_SECONDS 15.0 /* a status file that has not changed for so long is left from a dead process */
#define WATCH_SECONDS 3.0

static double seconds_now(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_REALTIME, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* Relative to the folder of the bake. */
static const char status_name[] = "checkpoint/status.json", stop_name[] = "checkpoint/stop";

/* Reads field 22 of /proc/PID/stat. The program name in it may contain anything, so the last bracket marks its end. */
uint64_t kiln_process_started(int64_t process)
{
    char path[64], text[1024];
    (void)snprintf(path, sizeof path, "/proc/%lld/stat", (long long)process);
    FILE *file = fopen(path, "re");
    if (file == NULL)
        return 0;
    const size_t size = fread(text, 1, sizeof text - 1, file);
    (void)fclose(file);
    text[size] = '\0';
    const char *at = strrchr(text, ')');
    if (at != NULL && (strncmp(at, ") Z", 3) == 0 || strncmp(at, ") X", 3) == 0))
        return 0; /* dead, and its parent has not waited for it yet */
    for (int field = 2; at != NULL && field < 22; field++)
        at = strchr(at + 1, ' ');
    return at != NULL ? strtoull(at, NULL, 10) : 0;
}

void kiln_bake_status_sign(struct kiln_bake_status *status)
{
    if (gethostname(status->host, sizeof status->host - 1) != 0)
        (void)snprintf(status->host, sizeof status->host, "unknown");
    status->process = getpid();
    status->started = kiln_process_started(status->process);
    status->updated = seconds_now();
}

void kiln_bake_status_write(const char *directory, const struct kiln_bake_status *s)
{
    struct kiln_publish place;
    int descriptor = -1;
    json_t *json = json_pack(
        "{s:s, s:o, s:f, s:f, s:f, s:f, s:i, s:o, s:I, s:I, s:f, s:I, s:I, s:f, s:i, s:o}", "state", s->state, "phase",
        kiln_json_string(s->phase), "phase_share", s->phase_share, "share", s->share, "left", s->left, "seconds",
        s->seconds, "ranks", (int)s->ranks, "host", kiln_json_string(s->host), "process", (json_int_t)s->process,
        "started", (json_int_t)s->started, "updated", s->updated, "beat", (json_int_t)s->beat, "generation",
        (json_int_t)s->generation, "saved", s->saved, "code", (int)s->code, "message", kiln_json_string(s->message));
    char *text = json != NULL ? json_dumps(json, JSON_INDENT(1)) : NULL;
    if (text != NULL && kiln_publish_begin(&place, directory, status_name, NULL) == KILN_OK) {
        bool written = kiln_publish_open(&place, &descriptor, NULL) == KILN_OK &&
                       kiln_write_all(descriptor, text, strlen(text), 0, status_name, NULL) == KILN_OK;
        if (descriptor >= 0)
            written = kiln_close(descriptor) == 0 && written;
        /* not synced, since after a power cut its content is outdated anyway */
        if (!written || kiln_publish_replace(&place, NULL) != KILN_OK)
            kiln_publish_abandon(&place);
    }
    free(text);
    json_decref(json);
}

static void take_text(const json_t *json, const char *key, char *text, size_t size)
{
    const char *value = json_string_value(json_object_get(json, key));
    kiln_text_copy(text, size, value != NULL ? value : "");
}

/* -1: an older kiln has not written it. */
static double number_or_unknown(const json_t *json, const char *key)
{
    const json_t *number = json_object_get(json, key);
    return json_is_number(number) ? json_number_value(number) : -1.0;
}

int kiln_bake_status_read(const char *directory, struct kiln_bake_status *s, struct kiln_error *error)
{
    char *text = NULL;
    size_t size = 0;
    json_t *json;
    int status = kiln_read_file_below(directory, status_name, 1 << 20, &text, &size, error);
    if (status != KILN_OK)
        return status;
    status = kiln_foreign_json(&json, KILN_JSON_CHILD, text, size, status_name, error);
    kiln_free(&text);
    if (status == KILN_SYSTEM)
        return status; /* a damaged file tells nothing */
    *s = (struct kiln_bake_status){0};
    take_text(json, "state", s->state, sizeof s->state);
    take_text(json, "phase", s->phase, sizeof s->phase);
    take_text(json, "host", s->host, sizeof s->host);
    take_text(json, "message", s->message, sizeof s->message);
    s->phase_share = number_or_unknown(json, "phase_share");
    s->share = number_or_unknown(json, "share");
    s->left = number_or_unknown(json, "left");
    s->seconds = json_number_value(json_object_get(json, "seconds"));
    s->updated = json_number_value(json_object_get(json, "updated"));
    s->saved = json_number_value(json_object_get(json, "saved"));
    s->ranks = (int32_t)json_integer_value(json_object_get(json, "ranks"));
    s->code = (int32_t)json_integer_value(json_object_get(json, "code"));
    s->process = json_integer_value(json_object_get(json, "process"));
    s->started = (uint64_t)json_integer_value(json_object_get(json, "started"));
    s->beat = (uint64_t)json_integer_value(json_object_get(json, "beat"));
    s->generation = (uint64_t)json_integer_value(json_object_get(json, "generation"));
    json_decref(json);
    return s->state[0] != '\0'
               ? KILN_OK
               : kiln_fail(error, KILN_BAD_INPUT, "'%s/%s' is not the status of a bake", directory, status_name);
}

void kiln_bake_status_remove(const char *directory)
{
    (void)kiln_unlink_below(directory, status_name);
    (void)kiln_unlink_below(directory, "checkpoint/.status.json.part");
}

bool kiln_bake_status_alive(const char *directory, const struct kiln_bake_status *s)
{
    struct kiln_bake_status here = {0}, later;
    if (strcmp(s->state, "running") != 0)
        return false;
    kiln_bake_status_sign(&here);
    if (strcmp(here.host, s->host) == 0 && kiln_process_started(s->process) == s->started)
        return true;
    if (strcmp(here.host, s->host) == 0 && kiln_process_started(s->process) != 0)
        return false;
    /* another host, or one with the same name and its own process numbers, such as a container */
    if (here.updated - s->updated > OLD_SECONDS ||
        (strcmp(here.host, s->host) == 0 && here.updated - s->updated > WATCH_SECONDS))
        return false;
    for (double waited = 0.0; waited < WATCH_SECONDS; waited += 0.1) {
        const struct timespec step = {0, 100000000};
        (void)nanosleep(&step, NULL);
        if (kiln_bake_status_read(directory, &later, NULL) == KILN_OK && later.beat != s->beat)
            return strcmp(later.state, "running") == 0;
    }
    return false;
}

int kiln_stop_request(const char *directory, struct kiln_error *error)
{
    int descriptor = -1;
    const int status = kiln_open_below(directory, stop_name, O_WRONLY | O_CREAT, 0666, &descriptor, error);
    if (descriptor >= 0)
        (void)close(descriptor);
    return status == KILN_OK || status == KILN_PERMISSION ? status : KILN_CANNOT_CREATE;
}

bool kiln_stop_requested(const char *directory)
{
    struct kiln_folder folder;
    struct stat found;
    const bool asked = kiln_folder_open(&folder, directory, "checkpoint", false, NULL) == KILN_OK &&
                       fstatat(folder.descriptor, "stop", &found, AT_SYMLINK_NOFOLLOW) == 0 && S_ISREG(found.st_mode);
    kiln_folder_close(&folder);
    return asked;
}

void kiln_stop_forget(const char *directory) { (void)kiln_unlink_below(directory, stop_name); }
