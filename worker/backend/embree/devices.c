#include <stdio.h>

#include "worker/backend/embree/embree.h"

/* Lists the CPU, if Embree starts on it: the library may have been built for another CPU, as its version tells. */
int embree_devices(struct kiln_device *list, size_t room, size_t *count, struct kiln_error *error)
{
    (void)error;
    struct kiln_device cpu = {.name = "CPU", .software = true, .float64 = true};
    RTCDevice device = rtcNewDevice(NULL);
    cpu.fit = device != NULL;
    if (cpu.fit)
        (void)snprintf(cpu.driver, sizeof cpu.driver, "%ld.%ld.%ld",
                       rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_VERSION_MAJOR),
                       rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_VERSION_MINOR),
                       rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_VERSION_PATCH));
    else
        (void)snprintf(cpu.driver, sizeof cpu.driver, "does not start");
    if (cpu.fit)
        rtcReleaseDevice(device);
    else
        (void)snprintf(cpu.lacks, sizeof cpu.lacks, "an Embree that starts");
    if (room > 0)
        list[0] = cpu;
    *count = 1;
    return KILN_OK;
}
