#include "coordinator/bake/prepare/import_params.h"

struct kiln_import_params kiln_job_import_params(const struct kiln_job *job, const char *output,
                                                 const struct kiln_stop *stop)
{
    return (struct kiln_import_params){.path = job->scene,
                                       .output = output,
                                       .texels_per_metre = job->texels_per_metre,
                                       .lightmap_size = job->lightmap_size,
                                       .lightmap_max = job->lightmap_max,
                                       .repack = job->repack,
                                       .keep_shared = job->keep_shared,
                                       .no_layout = job->store != KILN_STORE_KIND_LIGHTMAP,
                                       .environment = job->environment,
                                       .environment_scale = job->environment_scale,
                                       .environment_rotation_degrees = job->environment_rotation,
                                       .objects = job->objects,
                                       .changes = job->changed,
                                       .trust_normals = job->trust_normals,
                                       .up_z = job->up_z,
                                       .unit = job->unit,
                                       .strict = job->strict,
                                       .stop = stop};
}
