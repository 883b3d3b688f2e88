#include <stdio.h>

#include "worker/backend/embree/embree.h"

void embree_version(char *text, size_t size)
{
    RTCDevice device = rtcNewDevice(NULL);
    if (device == NULL) {
        (void)snprintf(text, size, "does not start");
        return;
    }
    (void)snprintf(text, size, "%ld.%ld.%ld", rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_VERSION_MAJOR),
                   rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_VERSION_MINOR),
                   rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_VERSION_PATCH));
    rtcReleaseDevice(device);
}
