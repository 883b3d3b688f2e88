/* Protocol between a reader and its child: for each file one request and one reply over a SOCK_SEQPACKET socket. Both
 * are the same program, so structs are sent as they are. Private to reader.c and reader_child.c. */
#ifndef KILN_COORDINATOR_OUTPUT_READ_READER_PRIVATE_H
#define KILN_COORDINATOR_OUTPUT_READ_READER_PRIVATE_H

#include <stdbool.h>
#include <stdint.h>

#include "coordinator/output/image.h"
#include "coordinator/output/volume_eval.h"
#include "worker/base/status.h"

enum reader_task { READER_RANGES, READER_IMAGE, READER_LIGHT };

enum { READER_PATH = 1024, READER_CHANNELS = 512, READER_DESCRIPTORS = 2 };

/* Request. The descriptor of the file is sent with it. READER_IMAGE sends a second descriptor, of an empty memory file
 * that receives the floats: all of channel 0, all of channel 1, and so on. */
struct reader_request {
    uint32_t task;
    uint32_t wanted_count; /* READER_IMAGE; 0: all channels */
    char wanted[READER_CHANNELS][KILN_CHANNEL_NAME_SIZE];
    double position[3]; /* READER_LIGHT */
    uint64_t seconds;   /* limit of CPU time */
    char path[READER_PATH];
};

struct reader_reply {
    int32_t status;
    char sentence[sizeof((struct kiln_error *)0)->message];
    uint32_t width, height, channel_count; /* READER_IMAGE */
    struct {
        char name[KILN_CHANNEL_NAME_SIZE];
        uint32_t half;
    } channels[READER_CHANNELS];
    struct kiln_volume_probe light; /* READER_LIGHT */
    struct kiln_volume_place place;
};

#endif
