#include "coordinator/bake/prepare/import_params.h"

struct kiln_import_params kiln_job_import_params(const struct kiln_job *job, const char *output,
                                                 const struct kiln_stop *stop)
{
    return (struct kiln_import_params){.path = job->scene.file,
                                       .output = output,
                                       .texels_per_metre = job->lightmaps.texels_per_metre,
                                       .texels = job->lightmaps.texels,
                                       .lightmap_size = job->lightmaps.size,
                                       .lightmap_max = job->lightmaps.most,
                                       .repack = job->scene.repack,
                                       .keep_shared = job->scene.keep_shared,
                                       .no_layout = job->lightmaps.store != KILN_STORE_KIND_LIGHTMAP,
                                       .environment = job->scene.environment,
                                       .environment_scale = job->scene.environment_scale,
                                       .environment_rotation_degrees = job->scene.environment_rotation,
                                       .objects = job->scene.objects,
                                       .changes = job->scene.changed,
                                       .trust_normals = job->scene.trust_normals,
                                       .up_z = job->scene.up_z,
                                       .unit = job->scene.unit,
                                       .strict = job->scene.strict,
                                       .stop = stop};
}
