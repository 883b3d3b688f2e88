#include "coordinator/output/read/reader.h"

#include <errno.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "coordinator/confined/confined.h"
#include "coordinator/files/plain_file.h"
#include "coordinator/output/read/reader_private.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"

struct kiln_reader {
    int threads;
    pid_t child; /* process number; 0: there is no child */
    int socket;
    struct reader_request request;
    struct reader_reply reply;
};

/* The limit of CPU time for a file of `bytes` bytes, in seconds. Decompression and checks process about 100 MB/s of
 * uncompressed data, which are at most a hundred times the file. */
static uint64_t seconds_for(uint64_t bytes) { return 4 + bytes / 1000000; }

static struct kiln_confined_call call_of(const struct kiln_reader *r, const char *const *arguments)
{
    return (struct kiln_confined_call){.arguments = arguments,
                                       .input = -1,
                                       .subject = r->request.path,
                                       .what = "the reader of results",
                                       .crashed = "it is damaged or somebody made it so; bake again",
                                       .costly = "it is damaged; bake again",
                                       .seconds = 30.0 + 10.0 * (double)r->request.seconds};
}

/* ---- starting and stopping the child ---- */

static int start(struct kiln_reader *r, struct kiln_error *error)
{
    int ends[2];
    char threads[16];
    const char *const arguments[] = {"kiln", "read-child", threads, NULL};
    struct kiln_confined_call call = call_of(r, arguments);
    (void)snprintf(threads, sizeof threads, "%d", r->threads);
    if (r->child != 0)
        return KILN_OK;
    if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends) != 0)
        return kiln_fail_errno(error, KILN_SYSTEM, "a socket to the reader of results cannot be made");
    call.input = ends[1];
    const int status = kiln_confined_start(&call, ends[1], &r->child, error);
    (void)close(ends[1]);
    if (status == KILN_OK) {
        r->socket = ends[0];
    } else {
        (void)close(ends[0]);
        r->child = 0;
    }
    return status;
}

/* Stops the child and returns its wait status. It ends by itself when the socket is closed, but a hostile file may have
 * taken control of it; `kill_it` ends it in any case. */
static int stop(struct kiln_reader *r, bool kill_it)
{
    const struct timespec step = {0, 2000000};
    int state = 0;
    if (r->child == 0)
        return 0;
    (void)close(r->socket);
    for (int k = 0; !kill_it && k < 1000 && waitpid(r->child, &state, WNOHANG) == 0; k++) {
        kill_it = k == 999;
        (void)nanosleep(&step, NULL);
    }
    if (kill_it) {
        (void)kill(r->child, SIGKILL);
        state = kiln_confined_wait(r->child);
    }
    r->child = 0;
    r->socket = -1;
    return state;
}

/* ---- one file ---- */

static int send_request(const struct kiln_reader *r, const int *descriptors, size_t count)
{
    union {
        struct cmsghdr align;
        char bytes[CMSG_SPACE(READER_DESCRIPTORS * sizeof(int))];
    } control = {.bytes = {0}};
    struct iovec part = {(void *)(uintptr_t)&r->request, sizeof r->request};
    struct msghdr message = {.msg_iov = &part,
                             .msg_iovlen = 1,
                             .msg_control = control.bytes,
                             .msg_controllen = CMSG_SPACE(count * sizeof(int))};
    struct cmsghdr *header = CMSG_FIRSTHDR(&message);
    header->cmsg_level = SOL_SOCKET;
    header->cmsg_type = SCM_RIGHTS;
    header->cmsg_len = CMSG_LEN(count * sizeof(int));
    memcpy(CMSG_DATA(header), descriptors, count * sizeof(int));
    ssize_t sent;
    do
        sent = sendmsg(r->socket, &message, MSG_NOSIGNAL);
    while (sent < 0 && errno == EINTR);
    return sent == (ssize_t)sizeof r->request;
}

static double now(void)
{
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

enum heard { HEARD, ENDED, LATE };

static enum heard hear(struct kiln_reader *r, double seconds)
{
    const double deadline = now() + seconds;
    for (;;) {
        struct pollfd wait = {.fd = r->socket, .events = POLLIN};
        const double left = deadline - now();
        if (left <= 0.0)
            return LATE;
        const int ready = poll(&wait, 1, left < 3600.0 ? (int)(left * 1000.0) + 1 : 3600000);
        if (ready == 0 || (ready < 0 && errno == EINTR))
            continue;
        const ssize_t got = recv(r->socket, &r->reply, sizeof r->reply, 0);
        if (got < 0 && errno == EINTR)
            continue;
        return got == (ssize_t)sizeof r->reply ? HEARD : ENDED;
    }
}

static bool is_status(int32_t status)
{
    return status == KILN_OK || status == KILN_BAD_INPUT || status == KILN_NO_INPUT || status == KILN_BUG ||
           status == KILN_SYSTEM || status == KILN_IO;
}

/* Sends r->request with the descriptors of the file and possibly of a memory file, and waits for the reply. */
static int ask(struct kiln_reader *r, const char *path, const int *descriptors, size_t count, struct kiln_error *error)
{
    struct stat found;
    (void)snprintf(r->request.path, sizeof r->request.path, "%s", path);
    if (fstat(descriptors[0], &found) != 0)
        return kiln_fail_errno(error, KILN_IO, "'%s' cannot be examined", path);
    r->request.seconds = seconds_for((uint64_t)found.st_size);
    const int status = start(r, error);
    if (status != KILN_OK)
        return status;
    const struct kiln_confined_call call = call_of(r, NULL);
    const enum heard heard = send_request(r, descriptors, count) ? hear(r, call.seconds) : ENDED;
    if (heard != HEARD) {
        const int state = stop(r, heard == LATE);
        return heard == LATE ? kiln_confined_late(&call, error) : kiln_confined_died(&call, state, error);
    }
    r->reply.sentence[sizeof r->reply.sentence - 1] = '\0';
    if (!is_status(r->reply.status)) {
        (void)stop(r, true);
        return kiln_fail(error, KILN_BAD_INPUT,
                         "'%s': the reader of results gave an invalid reply for this file; bake again", path);
    }
    return r->reply.status == KILN_OK ? KILN_OK : kiln_fail(error, r->reply.status, "%s", r->reply.sentence);
}

static void clear(struct kiln_reader *r, enum reader_task task)
{
    memset(&r->request, 0, sizeof r->request);
    r->request.task = task;
}

int kiln_reader_ranges(struct kiln_reader *r, int descriptor, const char *path, struct kiln_error *error)
{
    clear(r, READER_RANGES);
    return ask(r, path, &descriptor, 1, error);
}

int kiln_reader_light(struct kiln_reader *r, int descriptor, const char *path, const double position[3],
                      struct kiln_volume_probe *light, struct kiln_volume_place *place, struct kiln_error *error)
{
    clear(r, READER_LIGHT);
    memcpy(r->request.position, position, sizeof r->request.position);
    const int status = ask(r, path, &descriptor, 1, error);
    if (status == KILN_OK) {
        *light = r->reply.light;
        *place = r->reply.place;
    }
    return status;
}

/* ---- images ---- */

/* Creates the image that the reply describes over the floats in the memory file, after sealing its size. */
static int take_image(const struct kiln_reader *r, int memory, const char *path, struct kiln_image **image,
                      struct kiln_error *error)
{
    const struct reader_reply *reply = &r->reply;
    const char *names[READER_CHANNELS];
    struct stat found;
    bool good = reply->channel_count <= READER_CHANNELS && reply->width > 0 && reply->height > 0 &&
                fcntl(memory, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL) == 0 &&
                fstat(memory, &found) == 0;
    const unsigned __int128 bytes =
        (unsigned __int128)reply->width * reply->height * reply->channel_count * sizeof(float);
    good = good && bytes == (unsigned __int128)found.st_size;
    for (uint32_t i = 0; good && i < reply->channel_count; i++) {
        names[i] = reply->channels[i].name;
        good = memchr(names[i], '\0', KILN_CHANNEL_NAME_SIZE) != NULL;
    }
    if (!good)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "'%s': the reader of results gave an invalid reply for this file; bake again", path);
    int status;
    KILN_TRY(kiln_image_create_empty(image, reply->width, reply->height, names, reply->channel_count, error));
    KILN_TRY(kiln_image_share(*image, memory, error));
    for (uint32_t i = 0; i < reply->channel_count; i++)
        (*image)->channels[i].half = reply->channels[i].half != 0;
end:
    if (status != KILN_OK)
        kiln_image_destroy(image);
    return status;
}

int kiln_reader_image(struct kiln_reader *r, int descriptor, const char *path, const char *const *wanted,
                      size_t wanted_count, struct kiln_image **image, struct kiln_error *error)
{
    const int memory = memfd_create("kiln picture", MFD_CLOEXEC | MFD_ALLOW_SEALING);
    *image = NULL;
    if (memory < 0)
        return kiln_fail_errno(error, KILN_SYSTEM, "a file in memory cannot be made");
    clear(r, READER_IMAGE);
    r->request.wanted_count = (uint32_t)wanted_count;
    for (size_t i = 0; i < wanted_count; i++)
        (void)snprintf(r->request.wanted[i], sizeof r->request.wanted[i], "%s", wanted[i]);
    int status = ask(r, path, (const int[]){descriptor, memory}, 2, error);
    if (status == KILN_OK)
        status = take_image(r, memory, path, image, error);
    (void)close(memory);
    return status;
}

int kiln_reader_image_at(struct kiln_reader *r, const char *path, struct kiln_image **image, struct kiln_error *error)
{
    int descriptor;
    int status = kiln_open_plain(path, &descriptor, error);
    if (status != KILN_OK)
        return status;
    status = kiln_reader_image(r, descriptor, path, NULL, 0, image, error);
    (void)close(descriptor);
    return status;
}

/* ---- */

int kiln_reader_create(struct kiln_reader **reader, int threads, struct kiln_error *error)
{
    const int status = kiln_allocate(reader, 1, sizeof **reader, "a reader of results", error);
    if (status == KILN_OK) {
        (*reader)->threads = threads;
        (*reader)->socket = -1;
    }
    return status;
}

void kiln_reader_destroy(struct kiln_reader **reader)
{
    if (*reader == NULL)
        return;
    (void)stop(*reader, false);
    kiln_free(reader);
}
