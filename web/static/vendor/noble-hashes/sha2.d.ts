/** Of what hash.js takes from here; the files themselves are as they were published. */
export declare const sha256: {
  create(): { update(data: Uint8Array): unknown; digest(): Uint8Array };
};
