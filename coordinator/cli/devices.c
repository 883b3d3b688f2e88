#include "coordinator/cli/devices.h"

#include <stdio.h>

#include "coordinator/bake/prepare/prepare.h"
#include "coordinator/files/json.h"
#include "worker/backend/extended.h"
#include "worker/base/text.h"

enum { MOST_DEVICES = 64, UUID_TEXT = 37 };

static void uuid_text(const uint8_t uuid[16], char text[UUID_TEXT])
{
    size_t length = 0;
    for (size_t i = 0; i < 16; i++)
        length += (size_t)snprintf(text + length, UUID_TEXT - length, "%s%02x",
                                   i == 4 || i == 6 || i == 8 || i == 10 ? "-" : "", uuid[i]);
}

static json_t *device_json(const struct kiln_device *d)
{
    char uuid[UUID_TEXT], version[32];
    uuid_text(d->uuid, uuid);
    (void)snprintf(version, sizeof version, "%u.%u.%u", d->api_version >> 22 & 0x7f, d->api_version >> 12 & 0x3ff,
                   d->api_version & 0xfff);
    return json_pack("{s:i, s:o, s:o, s:s, s:s, s:b, s:b, s:s, s:b, s:b, s:i, s:I, s:I}", "device", (int)d->index,
                     "name", kiln_json_string(d->name), "driver", kiln_json_string(d->driver), "uuid", uuid, "vulkan",
                     version, "software", (int)d->software, "fit", (int)d->fit, "lacks", d->lacks, "ray_tracing",
                     (int)d->ray_tracing, "float64", (int)d->float64, "subgroup", (int)d->subgroup, "memory_bytes",
                     (json_int_t)d->memory, "free_bytes", (json_int_t)d->budget);
}

static json_t *list_json(const struct kiln_device *list, size_t count, const char *version)
{
    json_t *devices = json_array();
    for (size_t i = 0; i < count; i++)
        if (json_array_append_new(devices, device_json(&list[i])) != 0) {
            json_decref(devices);
            return NULL;
        }
    return json_pack("{s:s, s:{s:s, s:s, s:i}, s:o}", "status", "done", "embree", "version", version, "instruction_set",
                     kiln_own_instruction_set(), "threads", (int)kiln_own_cores(1), "vulkan", devices);
}

static void print_device(const struct kiln_device *d)
{
    kiln_print(stdout, "vulkan %u  %s%s\n", d->index, d->name, d->software ? " (software)" : "");
    if (!d->fit)
        (void)printf("          cannot be used: it lacks %s\n", d->lacks);
    if (d->driver[0] != '\0')
        (void)printf("          driver %s, Vulkan %u.%u.%u\n", d->driver, d->api_version >> 22 & 0x7f,
                     d->api_version >> 12 & 0x3ff, d->api_version & 0xfff);
    if (d->memory > 0)
        (void)printf("          %.1f GiB, %.1f GiB of it free; subgroups of %u\n", (double)d->memory / 0x1p30,
                     (double)d->budget / 0x1p30, d->subgroup);
    if (d->fit)
        (void)printf("          %s, %s\n", d->ray_tracing ? "ray-tracing pipeline" : "no ray-tracing pipeline",
                     d->float64 ? "doubles" : "no doubles: light is sampled in floats");
}

int kiln_devices_list(const struct kiln_job *job, struct kiln_error *error)
{
    struct kiln_device list[MOST_DEVICES], cpu;
    size_t count = 0, cpus = 0;
    int status = kiln_backend_devices("embree", &cpu, 1, &cpus, error);
    if (status == KILN_OK)
        status = kiln_backend_devices("vulkan", list, MOST_DEVICES, &count, error);
    if (status != KILN_OK)
        return status;
    count = count < MOST_DEVICES ? count : MOST_DEVICES;
    if (job->json)
        return kiln_json_print(list_json(list, count, cpu.driver), error);
    (void)printf("embree    %s, %s, %u thread%s\n", cpu.driver, kiln_own_instruction_set(), kiln_own_cores(1),
                 kiln_own_cores(1) == 1 ? "" : "s");
    for (size_t i = 0; i < count; i++)
        print_device(&list[i]);
    if (count == 0)
        (void)printf("vulkan    no device: no driver is installed, or none finds its hardware\n");
    return KILN_OK;
}
