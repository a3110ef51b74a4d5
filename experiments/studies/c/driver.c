/* Runs an exported monitor over an array of samples: for tests and studies on this machine. */
#include "gtm_monitor.h"

#include <string.h>

enum { R = GTM_MONITOR_RESIDUALS, W = GTM_MONITOR_WINDOWS };

unsigned long state_bytes(void);
void run(gtm_monitor_state *state, const float *rows, const uint64_t *times_us, long count, uint32_t *events, float *tests,
         float *others);

unsigned long state_bytes(void) { return sizeof(gtm_monitor_state); }

void run(gtm_monitor_state *state, const float *rows, const uint64_t *times_us, long count, uint32_t *events, float *tests,
         float *others)
{
    for (long k = 0; k < count; k++) {
        gtm_monitor_sample sample;
        memcpy(&sample, rows + k * (long)GTM_MONITOR_CHANNELS, sizeof sample);
        gtm_monitor_events e = gtm_monitor_update(state, &sample, times_us[k]);
        const uint32_t told[7] = {e.alarms, e.above, e.possible, e.involved, e.missing, e.flags, e.backlog_rows};
        memcpy(events + 7 * k, told, sizeof told);
        for (unsigned j = 0; tests != NULL && j < R; j++) {
            float *own = tests + ((k * (long)R + j) * (long)W) * 2, *beside = others + (k * (long)R + j) * 3;
            for (unsigned w = 0; w < W; w++) {
                own[2u * w] = gtm_monitor_statistic(state, j, w, 0u);
                own[2u * w + 1u] = gtm_monitor_statistic(state, j, w, 1u);
            }
            beside[0] = gtm_monitor_predicted(state, j);
            beside[1] = gtm_monitor_residual(state, j);
            beside[2] = gtm_monitor_noise_level(state, j);
        }
    }
}
