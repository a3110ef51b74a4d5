/* The exported folder's own test on a Cortex-M4, and then instructions a call: of a healthy flight that is made up (level,
 * with noise), the last fifth of it with a step of the first channel. qemu lets a time go by for each instruction. */
#define main folder_test
#include "test_gtm_monitor.c"
#undef main

#define TIMER ((volatile uint32_t *)0xE000E010u)
#define LONG_ROWS 15000u

static uint32_t random_bits = 1u;

static float noise(void)
{
    float sum = 0.0f;
    for (unsigned i = 0u; i < 12u; i++) {
        random_bits = random_bits * 1664525u + 1013904223u;
        sum += (float)(random_bits >> 8) / 16777216.0f;
    }
    return sum - 6.0f;
}

int main(void)
{
    TIMER[1] = 0xFFFFFFu;
    TIMER[2] = 0u;
    TIMER[0] = 5u;
    if (folder_test() != 0) {
        return 1;
    }
    gtm_monitor_init(&first);
    uint32_t begin = TIMER[2], nothing_done = begin - TIMER[2];
    for (unsigned row = 0u; row < LONG_ROWS; row++) {
        float values[GTM_MONITOR_CHANNELS];
        gtm_monitor_sample sample;
        for (unsigned c = 0u; c < GTM_MONITOR_CHANNELS; c++) {
            values[c] = NOISES[c] * noise() + (c == 0u && row > LONG_ROWS * 4u / 5u ? 10.0f * NOISES[0] : 0.0f);
        }
        memcpy(&sample, values, sizeof sample);
        begin = TIMER[2];
        gtm_monitor_events events = gtm_monitor_update(&first, &sample, (uint64_t)row * GTM_MONITOR_PERIOD_US);
        uint32_t ticks = ((begin - TIMER[2]) & 0xFFFFFFu) - nothing_done;
        printf("%u %lu %lu\n", row, (unsigned long)ticks, (unsigned long)events.alarms);
    }
    return 0;
}
