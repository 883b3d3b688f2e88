/* The child process of a reader (reader.h): parses the files that it receives, confined (coordinator/confined/fence.h).
 */
#include <errno.h>
#include <fcntl.h>
#include <hdf5.h>
#include <omp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include "coordinator/confined/fence.h"
#include "coordinator/output/exr.h"
#include "coordinator/files/publish.h"
#include "coordinator/output/read/rows.h"
#include "coordinator/output/read/ranges.h"
#include "coordinator/output/read/reader.h"
#include "coordinator/output/read/reader_private.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"

/* ---- limits ---- */

static bool ends_with(const char *path, const char *ending)
{
    const size_t length = strlen(path), own = strlen(ending);
    return length >= own && strcmp(path + length - own, ending) == 0;
}

static uint64_t machine_memory(void)
{
    const long pages = sysconf(_SC_PHYS_PAGES), size = sysconf(_SC_PAGESIZE);
    return pages > 0 && size > 0 ? (uint64_t)pages * (uint64_t)size : (uint64_t)1 << 34;
}

/* Limit of memory for a request. Images are decompressed as a whole, to at most 1,100 times their file size, and floats
 * take twice the memory of halves; other files are processed block by block. */
static uint64_t memory_for(const struct reader_request *request, uint64_t bytes)
{
    const uint64_t always = ((uint64_t)192 << 20) + ((uint64_t)16 << 20) * (uint64_t)omp_get_max_threads();
    const uint64_t factor = request->task == READER_IMAGE || ends_with(request->path, ".exr") ? 2400 : 1;
    const uint64_t wanted = always + (ends_with(request->path, ".json") ? (uint64_t)1 << 30 : 0) + factor * bytes,
                   most = machine_memory() / 4 * 3;
    return wanted < most ? wanted : most;
}

/* ---- tasks ---- */

static int write_channels(int memory, const struct kiln_image *image, struct kiln_error *error)
{
    const size_t bytes = (size_t)image->width * image->height * sizeof(float);
    int status = KILN_OK;
    for (size_t c = 0; status == KILN_OK && c < image->channel_count; c++) {
        status = kiln_write_all(memory, image->channels[c].values, bytes, c * bytes, "memory for a picture", error);
        kiln_free(&image->channels[c].values);
    }
    return status;
}

static int read_image(const struct reader_request *request, int file, int memory, struct reader_reply *reply,
                      struct kiln_error *error)
{
    const char *wanted[READER_CHANNELS];
    struct kiln_image *image = NULL;
    for (uint32_t i = 0; i < request->wanted_count; i++)
        wanted[i] = request->wanted[i];
    const bool rows = ends_with(request->path, ".h5") || ends_with(request->path, ".hdf");
    int status;
    KILN_TRY(rows && request->wanted_count > 0
                 ? kiln_datasets_read(file, request->path, wanted, request->wanted_count, &image, error)
                 : kiln_exr_read_open(file, request->path, request->wanted_count > 0 ? wanted : NULL,
                                      request->wanted_count, &image, error));
    if (image->channel_count > READER_CHANNELS)
        KILN_TRY(kiln_fail(error, KILN_BAD_INPUT, "'%s' has %zu channels, and at most %d are read", request->path,
                           image->channel_count, READER_CHANNELS));
    reply->width = image->width;
    reply->height = image->height;
    reply->channel_count = (uint32_t)image->channel_count;
    for (size_t c = 0; c < image->channel_count; c++) {
        memcpy(reply->channels[c].name, image->channels[c].name, KILN_CHANNEL_NAME_SIZE);
        reply->channels[c].half = image->channels[c].half;
    }
    KILN_TRY(write_channels(memory, image, error));
end:
    kiln_image_destroy(&image);
    return status;
}

static int read_light(const struct reader_request *request, int file, struct reader_reply *reply,
                      struct kiln_error *error)
{
    struct kiln_volume *volume = NULL;
    int status = kiln_volume_open_file(&volume, file, request->path, error);
    if (status == KILN_OK)
        status = kiln_volume_light(volume, request->position, &reply->light, &reply->place, error);
    kiln_volume_close(&volume);
    return status == KILN_IO ? KILN_BAD_INPUT : status;
}

static void do_task(const struct reader_request *request, const int *files, struct reader_reply *reply)
{
    struct kiln_error error = {""};
    struct stat found;
    int status = fstat(files[0], &found) == 0
                     ? KILN_OK
                     : kiln_fail_errno(&error, KILN_IO, "'%s' cannot be examined", request->path);
    memset(reply, 0, sizeof *reply);
    if (status == KILN_OK)
        kiln_fence_limits(memory_for(request, (uint64_t)found.st_size), request->seconds);
    if (status == KILN_OK && request->task == READER_RANGES)
        status = kiln_ranges_check(files[0], request->path, &error);
    else if (status == KILN_OK && request->task == READER_IMAGE)
        status = read_image(request, files[0], files[1], reply, &error);
    else if (status == KILN_OK)
        status = read_light(request, files[0], reply, &error);
    if (status == KILN_SYSTEM)
        status = kiln_fail(&error, KILN_BAD_INPUT,
                           "'%s': reading it takes more memory than the %llu MiB that its size justifies, or than "
                           "there is: it is damaged; bake again",
                           request->path, (unsigned long long)(memory_for(request, (uint64_t)found.st_size) >> 20));
    reply->status = status;
    memcpy(reply->sentence, error.message, sizeof reply->sentence);
}

/* ---- messages ---- */

/* Receives the next request with its files; false if there is none any more. */
static bool next_request(struct reader_request *request, int files[READER_DESCRIPTORS])
{
    union {
        struct cmsghdr align;
        char bytes[CMSG_SPACE(READER_DESCRIPTORS * sizeof(int))];
    } control;
    struct iovec part = {request, sizeof *request};
    struct msghdr message = {
        .msg_iov = &part, .msg_iovlen = 1, .msg_control = control.bytes, .msg_controllen = sizeof control.bytes};
    ssize_t got;
    do
        got = recvmsg(STDIN_FILENO, &message, MSG_CMSG_CLOEXEC);
    while (got < 0 && errno == EINTR);
    const struct cmsghdr *header = got > 0 ? CMSG_FIRSTHDR(&message) : NULL;
    const size_t count = request->task == READER_IMAGE ? 2 : 1;
    if (got != (ssize_t)sizeof *request || header == NULL || header->cmsg_type != SCM_RIGHTS ||
        header->cmsg_len != CMSG_LEN(count * sizeof(int)) || request->wanted_count > READER_CHANNELS)
        return false;
    memcpy(files, CMSG_DATA(header), count * sizeof(int));
    return true;
}

static bool send_reply(const struct reader_reply *reply)
{
    ssize_t sent;
    do
        sent = send(STDOUT_FILENO, reply, sizeof *reply, MSG_NOSIGNAL);
    while (sent < 0 && errno == EINTR);
    return sent == (ssize_t)sizeof *reply;
}

int kiln_reader_child(int argc, char **argv)
{
    static struct reader_request request;
    static struct reader_reply reply;
    struct stat input;
    if (argc != 3 || fstat(STDIN_FILENO, &input) != 0 || !S_ISSOCK(input.st_mode)) {
        (void)fprintf(stderr, "read-child is an internal command of kiln\n");
        return KILN_USAGE;
    }
    kiln_fence_begin();
    const int threads = atoi(argv[2]);
    if (threads > 0)
        omp_set_num_threads(threads);
    (void)H5dont_atexit();
    (void)H5open();
    kiln_fence_calls();
    for (int files[READER_DESCRIPTORS] = {-1, -1}; next_request(&request, files);) {
        do_task(&request, files, &reply);
        for (int i = 0; i < READER_DESCRIPTORS; i++) {
            if (files[i] >= 0)
                (void)close(files[i]);
            files[i] = -1;
        }
        if (!send_reply(&reply))
            break;
    }
    return KILN_OK;
}
